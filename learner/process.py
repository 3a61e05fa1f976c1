"""The process that trains, from its options to its last line of output."""

import os
import sys
import threading
from contextlib import suppress
from dataclasses import replace
from functools import partial

import torch

from common.atomic_file import write_atomically
from common.endpoint import from_here
from common.exit_codes import RED
from common.network import QNetwork
from common.process.allocator import keep_large_blocks
from common.process.lifeline import on_signals
from common.process.log_lines import kept_log, say, say_aside
from common.process.threads import end_with_any_thread
from common.run.folder import RunFolder
from common.run.network_file import encode_network_file
from common.run.newest_learner import Ended, NewestLearner
from common.run.origin import identity_of
from common.transport.signature import signer
from learner.algorithm.interface import build_algorithm
from learner.assembly import build_learner
from learner.demonstrations.recording import Demonstrations
from learner.demonstrations.start import begin_with, insert_all
from learner.device import Device, choose_device
from learner.endpoints import open_pages, open_replay
from learner.first_network import first_network
from learner.local_launcher import launch
from learner.options import (
    LearnerOptions,
    free_cores,
    going_on,
    join_command,
)
from learner.resume import resume_command
from learner.telemetry.sinks.display import open_display
from learner.telemetry.sinks.kept_log import KeptLogSink
from learner.training import Learner


def train(options: LearnerOptions, again: bool) -> int:
    """Trains in this process; returns the exit code. The loop itself is `Learner.run`.

    Args:
        again: whether this process continues the run of one that was killed.
    """
    if again:
        options = going_on(options)
    config, folder = options.config, options.folder
    sign = signer(options.certificates)
    given = None if options.initial is None else identity_of(options.initial)
    network = first_network(options, folder)
    demonstrations = begin_with(options.demonstrations, config, folder, resume=options.resume)
    device = choose_device(
        options.device,
        options.precision,
        options.kernel,
        network=network,
        graphs=options.cuda_graphs,
    )
    algorithm = build_algorithm(config, network, device)
    keep_large_blocks()
    torch.set_num_threads(options.threads or free_cores(options))
    stop = threading.Event()
    on_signals(stop)
    begin = partial(_write_beginning, options, folder, network, given, demonstrations)
    folder.claim("learner", config, resume=options.resume, begin=begin)
    with (
        folder.removed_if_unused(),
        kept_log(folder.logs / "learner.jsonl", "learner") as keep,
        end_with_any_thread(stop),
        open_pages(options, folder) as (pages, page),
        open_replay(options, folder, stop) as (transport, replay, endpoint),
        open_display(as_json=options.log_json) as display,
    ):
        learner = build_learner(
            options,
            folder,
            transport,
            replay,
            algorithm,
            device,
            display,
            stop,
            KeptLogSink(keep),
            *pages,
            sign=sign,
            page=page,
        )
        write_newest = partial(_write_newest, options, folder, from_here(endpoint), learner)
        with learner.telemetry:
            write_newest()
            keep("started")  # so that an error before it is no longer the last word
            if page is not None:
                display.line(f"watch the run at {page}")
            sent = demonstrations is None or insert_all(
                demonstrations, transport, replay, folder, stop, display.line
            )
            # A run that was stopped while it sent them begins when it is resumed, with all of them.
            if sent:
                learner.start()
                disk = replay.progress().file_bytes
                display.line(_first_words(options, folder, device, disk, endpoint))
                local = options.local and not stop.is_set()
                needed = needed_children(options, learner)
                learner.run(launch(needed, from_here(endpoint), folder) if local else None)
            with suppress(OSError):  # a disk that is full by now has what was learned
                write_newest("done" if learner.phases.done else "stopped")
            if learner.failed is not None:
                keep(f"stopped: {learner.failed}", "ERROR")
    return _last_words(learner, folder)


def needed_children(options: LearnerOptions, learner: Learner) -> LearnerOptions:
    """Returns the options with as many actors and evaluators as the run still needs: a resumed run
    that has its steps needs no actors, and evaluators only for tests that are to come."""
    if not learner.phases.done:
        return options
    evaluators = options.evaluators if learner.has_tests_to_come else 0
    return replace(options, actors=0, evaluators=evaluators)


def _write_beginning(
    options: LearnerOptions,
    folder: RunFolder,
    network: QNetwork,
    given: str | None,
    demonstrations: Demonstrations | None,
) -> None:
    """Writes the weights and the recording with which the run begins, if they were given.

    Args:
        given: identity of the network that the weights came from.
    """
    if not options.resume:  # a start that failed may have left them
        folder.initial.unlink(missing_ok=True)
        folder.demonstrations.unlink(missing_ok=True)
    if given is not None and not folder.initial.exists():
        write_atomically(
            folder.initial, encode_network_file(network, options.config, identity=given)
        )
    if demonstrations is not None:
        write_atomically(folder.demonstrations, demonstrations.begun.encode())


def _write_newest(
    options: LearnerOptions,
    folder: RunFolder,
    endpoint: str,
    learner: Learner,
    ended: Ended | None = None,
) -> None:
    """Writes where the run is found, how it goes on, and how the learner ``ended``."""
    given = options.certificates
    certificates = None if given is None else str(given.resolve())
    command = resume_command(sys.argv[1:], folder.name, done=learner.phases.done)
    NewestLearner(
        str(folder.path.resolve()),
        endpoint,
        certificates,
        os.getcwd(),
        command,
        learner.evaluation.snapshots.keep,
        ended,
    ).write(folder)


def _first_words(
    options: LearnerOptions, folder: RunFolder, device: Device, disk: int, endpoint: str
) -> str:
    """Returns the sentence that says what is trained and where, with the ``disk`` bytes that its
    replay takes."""
    config, join = options.config, "" if options.local else f" ({join_command(options)})"
    if from_here(endpoint) != endpoint:
        join = f", any address of this machine (here by {join_command(options)})"
    goal = options.steps
    ends = "it trains until it is stopped" if goal is None else f"it ends at {goal:,} agent steps"
    return (
        f"run {folder.name} in {folder.path}: {config.played}, preset {config.preset}, "
        f"{config.learning.algorithm}, on {device.name}; its replay takes "
        f"{disk / 1e9:.2f} GB of disk; actors find it at {endpoint}{join}; "
        f"{ends}."
    )


def _last_words(learner: Learner, folder: RunFolder) -> int:
    """Prints how to continue the run; returns the exit code."""
    failed = learner.failed is not None
    go_on = resume_command(sys.argv[1:], folder.name, done=learner.phases.done, force=failed)
    # The command has a line of its own, which a narrow terminal does not break within a word.
    if not failed:
        say(f"Everything is in {folder.path}; go on with:\n  {go_on}")
        return 0
    told = (
        f"stopped: {learner.failed}. Everything is in {folder.path}; fix what is wrong, or "
        f"train on regardless with:\n  {go_on}"
    )
    say_aside(told, "error")
    return RED
