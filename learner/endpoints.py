"""The endpoints of a learner: its own hub and replay, or those of --connect; pages over HTTP."""

import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager

from common.errors import InputError
from common.process.extras import extra_for
from common.process.http_endpoints import http_endpoints
from common.protocol.run_keys import RunKeys
from common.run.folder import RunFolder
from common.run.join import find_run, patiently
from common.settings.stored_config import differences
from common.transport.chosen import connect, open_hub
from common.transport.flood_guard import tolerated
from common.transport.interface import Transport, Unanswered
from learner.options import LearnerOptions, web_address
from learner.telemetry.sinks.sink import Sink
from replay.client import RemoteReplay
from replay.interface import Replay
from replay.replay_buffer import ReplayBuffer
from replay.server import ReplayServer

_DEADLINE = 2.0
"""Seconds that another learner has to answer."""


@contextmanager
def open_replay(
    options: LearnerOptions, folder: RunFolder, stop: threading.Event
) -> Iterator[tuple[Transport, Replay, str]]:
    """Yields transport, replay and the hub's address: in this process, or at ``--connect``.

    Raises:
        InputError: this process cannot listen at the address, nobody answers there, another run
            is served there, or another learner trains this run.
    """
    config, endpoint = options.config, options.connect
    if endpoint is None:
        most = tolerated(options.actor_quota)
        folder.claim("replay", config, resume=options.resume)
        with (
            open_hub(options.listen, options.certificates, most, folder.name) as transport,
            closing(ReplayBuffer(config, folder.replay)) as buffer,
            ReplayServer(transport, buffer, config, folder.name, options.actor_quota),
        ):
            yield transport, buffer, options.listen
        return
    patience = options.patience
    stopped = patiently(stop, endpoint, patience)
    with connect(
        endpoint, patience, stopped, role="learner", certificates=options.certificates
    ) as transport:
        keys, served = find_run(transport, folder.name, patience, stopped, options.certificates)
        if unequal := differences(served, config):
            raise InputError(
                f"the replay at {endpoint} serves {folder.name} with another configuration "
                f"({'; '.join(unequal[:5])}): give both processes the same flags."
            )
        if _has_learner(transport, keys):
            raise InputError(
                f"another learner trains {folder.name} at {endpoint}, and actors would play by the "
                "weights of both: end that one first, or begin another run."
            )
        replay = RemoteReplay(transport, keys, served)

        def let_go() -> None:
            stop.wait()
            replay.close()

        threading.Thread(target=let_go, name="let-go", daemon=True).start()
        with closing(replay):
            yield transport, replay, endpoint


def _has_learner(transport: Transport, keys: RunKeys) -> bool:
    """Returns whether a learner answers for the run. One that starts, which takes long if it sends
    demonstrations, only refuses to tell its status."""
    with closing(transport.requester(keys.status, _DEADLINE)) as requester:
        outcome = requester.request(b"").exception()
    return not isinstance(outcome, Unanswered)


@contextmanager
def open_pages(
    options: LearnerOptions, folder: RunFolder
) -> Iterator[tuple[Sequence[Sink], str | None]]:
    """Yields the sinks behind ``--http`` and ``--web``, and the address of the page for people.

    The servers listen already. Their packages are loaded only if the flags are given.

    Raises:
        InputError: a package is not installed, or this process cannot listen at the address.
    """
    sinks: list[Sink] = []
    url = None
    with ExitStack() as stack:
        if options.http is not None:
            with extra_for("--http", "ops"):
                from learner.telemetry.sinks.prometheus import PrometheusSink
            sinks.append(figures := PrometheusSink())
            stack.enter_context(http_endpoints(options.http, figures.pages))
        if options.web is not None:
            with extra_for("--web", "web"):
                from learner.telemetry.web.page_sink import PageSink
            page = PageSink(*web_address(options.web), options.config, folder)
            stack.callback(page.close)  # whether or not telemetry begins
            sinks.append(page)
            url = page.url
        yield sinks, url
