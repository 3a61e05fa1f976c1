"""``python -m replay``: the replay as a process of its own, which is the run's hub.

The learner joins it with ``--connect``, as the actors do. With ``--connect``, the replay itself
joins the hub of another run, so that one address serves both.
"""

if __name__ == "__main__":
    import os
    import sys

    # A working directory that does not hold this package may hold another `common`.
    if not sys.flags.safe_path and sys.path[0] != os.path.abspath(f"{__file__}/../.."):
        del sys.path[0]
        os.environ["PYTHONSAFEPATH"] = "1"  # for the programs that this one starts

    from common.process.lifeline import leave_at_interrupt

    leave_at_interrupt()

import logging
import math
import shlex
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial

import tyro

from common.command_line.parser import started_by, without_flags
from common.command_line.run_options import RunOptions, parse_run
from common.endpoint import DEFAULT_ENDPOINT
from common.errors import InputError
from common.process.allocator import keep_large_blocks
from common.process.http_endpoints import http_endpoints
from common.process.http_page import Page, verdict
from common.process.lifeline import on_signals
from common.process.log_lines import kept_log, say, say_json
from common.process.program_end import exit_on_input_error
from common.process.restarts import with_restarts
from common.process.service_manager import tell
from common.process.threads import end_with_any_thread
from common.protocol.run_keys import RunKeys
from common.run.folder import RunFolder
from common.run.join import patiently
from common.transport.chosen import connect, open_hub
from common.transport.flood_guard import tolerated
from common.transport.interface import Transport
from replay.chunk_statistics import ReplayProgress
from replay.replay_buffer import ReplayBuffer
from replay.server import ReplayServer

_log = logging.getLogger(__name__)
_REPORT_SECONDS = 5.0
_DEADLINE = 5.0
"""Seconds to wait for the announcement of a run of the same name."""


@dataclass(frozen=True)
class ReplayOptions(RunOptions):
    """Store the actors' transitions, and serve minibatches of them to the learner.

    The transitions are kept in <runs>/<run>/replay.
    """

    run: str = tyro.MISSING
    """Name of the run."""
    connect: str | None = None
    """Address of another run's hub, instead of --listen; learner and actors then find this run
    there too."""


def main() -> int | None:
    """Serves until Ctrl-C or SIGTERM."""
    options = parse_run(
        ReplayOptions,
        "replay",
        sys.argv[1:],
        lambda options: (
            RunFolder(options.runs, options.run).stored_config() if options.resume else None
        ),
    )
    if options.log_json:
        say_json("replay")
    return with_restarts("the replay", partial(serve, options), options.restart)


def serve(options: ReplayOptions, again: bool) -> None:
    """Serves in this process; ``again`` says whether it replaces a process that was killed."""
    keep_large_blocks()
    config = options.config
    folder = RunFolder(options.runs, options.run)
    resume = options.resume or (again and folder.stored_config() is not None)
    folder.claim("replay", config, resume=resume)
    stop = threading.Event()
    on_signals(stop)
    pages: dict[str, Callable[[], Page]] = {}
    with (
        folder.removed_if_unused(),
        kept_log(folder.logs / "replay.jsonl", "replay"),
        end_with_any_thread(stop),
        http_endpoints(options.http, lambda: pages),  # first: a refused start makes no ring
        _open(options, stop) as transport,
        closing(ReplayBuffer(config, folder.replay)) as buffer,
    ):
        with ReplayServer(transport, buffer, config, folder.name, options.actor_quota):
            if options.http is not None:
                pages |= _pages(buffer, folder.name)
            place = options.connect or options.listen
            say(f"replay of run {folder.name} in {folder.replay}, at {place}.")
            say(_line(buffer.progress()))
            tell("READY=1")
            failed = ""
            while not stop.wait(_REPORT_SECONDS):
                progress = buffer.progress()
                say(_line(progress), progress.values())
                tell(f"STATUS={_line(progress)}", "WATCHDOG=1")
                if failed:
                    raise InputError(failed)
                failed = progress.failed  # one report later the learner has heard of it, too
            tell("STOPPING=1")
        say(_line(buffer.progress()))
    flags = without_flags(sys.argv[1:], ["--initial"], ["--resume"])
    go_on = shlex.join([*started_by("replay").split(), *flags, "--resume"])
    say(f"The replay is in {folder.replay}; go on with:\n  {go_on}")


def _open(options: ReplayOptions, stop: threading.Event) -> Transport:
    """Opens the run's hub, or joins another run's hub."""
    hub = options.connect
    if hub is None:
        most = tolerated(options.actor_quota)
        return open_hub(options.listen, options.certificates, most, options.run)
    if options.listen != DEFAULT_ENDPOINT:
        raise InputError("a replay either listens or joins a hub: give --listen or --connect.")
    transport = connect(
        hub,
        math.inf,
        patiently(stop, hub),
        role="replay",
        name=options.run,
        certificates=options.certificates,
    )
    with ExitStack() as undo:
        undo.enter_context(transport)
        served = {answer.key for answer in transport.gather(RunKeys("*").config, _DEADLINE)}
        if RunKeys(options.run).config in served:
            raise InputError(
                f"the hub at {hub} serves a run called {options.run}: name another with --run."
            )
        undo.pop_all()
    if not served and options.certificates is not None:
        text = (
            "the hub at %s does not announce its own run: if nobody finds %s, check whether the "
            "hub's runs.txt listed it when the hub was started"
        )
        _log.warning(text, hub, options.run)
    return transport


def _pages(buffer: ReplayBuffer, run: str) -> dict[str, Callable[[], Page]]:
    """Returns the pages of ``--http``. A replay that answers at all works, and its run is ready."""
    from common.exposition import families, metrics_page

    def works() -> Page:
        buffer.progress()
        return verdict([])

    figures = metrics_page(lambda: families({**buffer.progress().values(), "run/run": run}))
    return {"/healthz": works, "/readyz": works, "/metrics": figures}


def _line(progress: ReplayProgress) -> str:
    return (
        f"{progress.agent_steps:,} steps, {progress.stored:,} stored, "
        f"{progress.samplable:,} can be drawn; chunks: {progress.accepted:,} accepted, "
        f"{progress.duplicates:,} duplicate, {progress.refused:,} refused"
        f"{'; actors are throttled' if progress.throttle else ''}; "
        f"{progress.private_bytes / 1e6:,.0f} MB private, "
        f"{progress.resident_bytes / 1e6:,.0f} MB resident, "
        f"{progress.file_bytes / 1e9:.2f} GB of file."
    )


if __name__ == "__main__":
    exit_on_input_error(main)
