"""`python -m learner`: trains the run's network, and hosts its replay and hub."""

if __name__ == "__main__":
    from common.process.lifeline import leave_at_interrupt

    leave_at_interrupt()

import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import torch

from common.errors import InputError, exit_on_input_error
from common.network import QNetwork, build_network
from common.process.allocator import keep_large_blocks
from common.process.command_line import parse_run
from common.process.exit_codes import INTERRUPTED, RED
from common.process.extras import extra_for
from common.process.http_endpoints import http_endpoints
from common.process.lifeline import on_signals
from common.process.log_lines import kept_log, line, say_json
from common.process.restarts import with_restarts
from common.process.threads import end_with_any_thread
from common.protocol.run_keys import RunKeys
from common.protocol.weights import encode_weights, load_weights_file
from common.run.folder import RunFolder, write_atomically
from common.run.join import find_run, patiently
from common.run.origin import check_fit, origin_of
from common.run.stored_config import differences
from common.transport.endpoint import from_here
from common.transport.interface import Transport
from common.transport.zenoh_transport import connect, open_hub
from learner import status
from learner.algorithm.interface import build_algorithm
from learner.assembly import build_learner
from learner.demonstrations import begin_with
from learner.device import choose_device
from learner.evaluation.offline import evaluate
from learner.local_launcher import launch
from learner.options import (
    LearnerOptions,
    free_cores,
    going_on,
    join_command,
    resume_command,
    run_name,
    stored_config,
)
from learner.telemetry.sinks.display import open_display
from learner.telemetry.sinks.kept_log import KeptLogSink
from learner.telemetry.sinks.sink import Sink
from replay.client import RemoteReplay
from replay.interface import Replay
from replay.replay_buffer import ReplayBuffer
from replay.server import ReplayServer

if TYPE_CHECKING:
    from learner.telemetry.web.page_sink import PageSink


@contextmanager
def hosted_replay(
    options: LearnerOptions, folder: RunFolder
) -> Iterator[tuple[Transport, Replay, str]]:
    """Hub and replay in this process; also the address at which they are found."""
    config = options.config
    folder.claim("replay", config, begun=folder.replay, resume=options.resume)
    with open_hub(options.listen, options.certificates) as transport:
        memory = ReplayBuffer(config, folder.replay)
        try:
            with ReplayServer(transport, memory, config, folder.name):
                yield transport, memory, options.listen
        finally:
            memory.close()


@contextmanager
def remote_replay(
    options: LearnerOptions, endpoint: str, folder: RunFolder, stop: threading.Event
) -> Iterator[tuple[Transport, Replay, str]]:
    """Hub and replay of another process, which must serve this run."""
    stopped = patiently(stop, endpoint)
    with connect(
        endpoint,
        options.patience,
        stopped,
        role="learner",
        certificates=options.certificates,
    ) as transport:
        keys, config = find_run(transport, folder.name, options.patience, stopped)
        if unequal := differences(config, options.config):
            raise InputError(
                f"the replay at {endpoint} serves {folder.name} with another configuration "
                f"({'; '.join(unequal[:5])}): give both processes the same flags."
            )
        replay = RemoteReplay(transport, keys, config)

        def let_go() -> None:
            stop.wait()
            replay.close()

        threading.Thread(target=let_go, name="let-go", daemon=True).start()
        yield transport, replay, endpoint


@contextmanager
def operators_page(options: LearnerOptions) -> Iterator[list[Sink]]:
    """What ``--http`` serves, from before there is anything to tell; empty without it."""
    if options.http is None:
        yield []
        return
    with extra_for("--http", "ops"):
        from learner.telemetry.sinks.prometheus import PrometheusSink
    sink = PrometheusSink()
    with http_endpoints(options.http, sink.pages):
        yield [sink]


def web_page(options: LearnerOptions, folder: RunFolder) -> list["PageSink"]:
    """The page of --web, which listens already; what serves it is loaded only where it is wanted.

    Raises:
        InputError: it is not installed, or nobody can listen there.
    """
    if options.web is None:
        return []
    with extra_for("--web", "web"):
        from learner.telemetry.web.page_sink import PageSink
    return [PageSink(options.web, options.config, folder)]


def first_network(options: LearnerOptions, folder: RunFolder) -> QNetwork:
    """The network that a run begins with; one that has a checkpoint takes its weights from there.

    Raises:
        InputError: it cannot be read, is not for what the run plays, or is given to a run that
            began with another one.
    """
    network = build_network(options.config, options.config.action_count)
    initial = options.initial
    began = folder.initial if options.resume and folder.initial.exists() else None
    if initial is None and began is not None and not folder.checkpoint.exists():
        initial = began  # it ended before its first checkpoint
    if initial is not None:
        check_fit(initial, origin_of(initial), options.config)
        load_weights_file(network, initial, "this run")
    # The same flags may start a run and go on with it, as a service's do.
    again = options.resume and options.initial is not None and folder.config_file.exists()
    if again and (began is None or encode_weights(network) != began.read_bytes()):
        raise InputError(
            f"the run in {folder.path} did not begin with {options.initial}: omit --initial, or "
            "name another run."
        )
    return network


def main() -> int | None:
    if "--status" in sys.argv[1:]:
        return status.main([each for each in sys.argv[1:] if each != "--status"])
    options, stored = parse_run(LearnerOptions, "learner", sys.argv[1:], stored_config)
    options.check()
    if options.evaluation.evaluate is not None:
        stop = threading.Event()
        on_signals(stop)
        found = evaluate(options.evaluation, options.config, stored, options.clock, stop)
        return INTERRUPTED if found is None else 0
    if options.log_json:
        say_json("learner")
    return with_restarts("the learner", partial(train, options), options.restart)


def train(options: LearnerOptions, again: bool) -> int:
    """Train in this process; ``again`` after one that was killed."""
    if again:
        options = going_on(options)
    config = options.config
    folder = RunFolder(options.runs, run_name(options))
    network = first_network(options, folder)
    demonstrations = begin_with(options.demonstrations, config, folder, resume=options.resume)
    device = choose_device(options.device, options.precision)
    algorithm = build_algorithm(config, network, device)
    keep_large_blocks()
    torch.set_num_threads(options.threads or free_cores(options))
    stop = threading.Event()
    on_signals(stop)
    begun = folder.checkpoint if folder.checkpoint.exists() else folder.previous
    folder.claim("learner", config, begun=begun, resume=options.resume)
    place = (
        hosted_replay(options, folder)
        if options.connect is None
        else remote_replay(options, options.connect, folder, stop)
    )
    with (
        folder.removed_if_unused(),
        end_with_any_thread(stop),
        kept_log(folder.logs / "learner.jsonl", "learner") as keep,
        operators_page(options) as page,
        nullcontext(web_page(options, folder)) as web,
        place as (transport, replay, endpoint),
        open_display(as_json=options.log_json) as display,
        ExitStack() as stack,
    ):
        # Not before the replay is ours too: a start that is refused changes nothing.
        if options.initial is not None:
            write_atomically(folder.initial, encode_weights(network))
        elif not options.resume:
            folder.initial.unlink(missing_ok=True)  # of a start that failed
        if demonstrations is not None:
            demonstrations.begun.write(folder)
        elif not options.resume:
            folder.demonstrations.unlink(missing_ok=True)
        learner = build_learner(
            *(options, folder, transport, replay, algorithm, device, display, stop),
            *(KeptLogSink(keep), *page, *web),
        )
        for each in web:
            display.line(f"watch the run at {each.url}")
        if demonstrations is not None:
            keys = RunKeys(folder.name, replay.run_id)
            if demonstrations.insert(transport, keys, stop, display.line):
                replace(demonstrations.begun, complete=True).write(folder)
        learner.start()
        children = None
        if options.local:
            children = launch(options, from_here(endpoint), folder)
            stack.callback(children.close)
        display.line(
            f"run {folder.name} in {folder.path}: {config.game} ({config.env}), preset "
            f"{config.preset}, on {device.name}; actors find it at {endpoint}"
            f"{f' ({command})' if (command := join_command(options)) else ''}."
        )
        learner.run(children)
    go_on = resume_command(sys.argv[1:], folder.name, done=learner.done)
    if learner.failed is not None:
        told = (
            f"stopped: {learner.failed}. Everything is in {folder.path}; mend what is wrong, or "
            f"train on regardless with: {go_on} --force"
        )
        print(line(told, "error"), file=sys.stderr)
        return RED
    print(line(f"Everything is in {folder.path}; go on with: {go_on}"))
    return 0


if __name__ == "__main__":
    exit_on_input_error(main)
