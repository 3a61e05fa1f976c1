"""Builds a learner from its parts, and restores them from a checkpoint if there is one."""

import threading
from collections.abc import Sequence
from functools import partial

from common.metrics import Values
from common.protocol.run_keys import RunKeys, replay_of
from common.run.epochs import EpochTable
from common.run.folder import RunFolder
from common.run.origin import copied_from
from common.settings.stored_config import flat
from common.transport.interface import Transport
from common.transport.signature import Sign
from learner.algorithm.interface import Algorithm
from learner.broadcast import Broadcast
from learner.checkpoint import Checkpoint
from learner.demonstrations.record import DemonstrationsRecord
from learner.device import Device
from learner.evaluation.coordinator import EvaluationCoordinator
from learner.evaluation.service import serve_evaluators
from learner.evaluation.snapshots import Snapshots
from learner.health_guard import HealthGuard
from learner.loss_guard import LossGuard
from learner.options import LearnerOptions, clock_figures, join_command
from learner.phases import Phases
from learner.prefetch import Prefetcher, to_device
from learner.run_clock import RunClock
from learner.telemetry.actor_registry import ActorRegistry
from learner.telemetry.held_out import HeldOut
from learner.telemetry.live_feed import LiveFeed
from learner.telemetry.provenance import provenance
from learner.telemetry.sinks.display import Display
from learner.telemetry.sinks.films import FilmsSink
from learner.telemetry.sinks.gates_csv import GatesCsvSink
from learner.telemetry.sinks.service_manager import ServiceManagerSink
from learner.telemetry.sinks.sink import Sink
from learner.telemetry.sinks.status import StatusSink
from learner.telemetry.sinks.summary import SummarySink
from learner.telemetry.sinks.tensorboard import TensorBoardSink
from learner.telemetry.sinks.tracker import TrackedRun, TrackerSink
from learner.telemetry.telemetry import Telemetry
from learner.training import Learner
from replay.interface import Replay


def build_learner(
    options: LearnerOptions,
    folder: RunFolder,
    transport: Transport,
    replay: Replay,
    algorithm: Algorithm,
    device: Device,
    display: Display,
    stop: threading.Event,
    *more_sinks: Sink,
    sign: Sign,
    page: str | None = None,
) -> Learner:
    """Returns the learner of the run in ``folder``, not yet started. Its telemetry is open.

    Args:
        more_sinks: sinks that take the run's figures beside the usual ones.
        sign: signs the weights that actors and evaluators play by.
        page: address of the page that shows the run, if there is one.

    Raises:
        InputError: a file of the run is damaged.
    """
    config = options.config
    checkpoint = Checkpoint(folder.checkpoint, folder.previous, algorithm, config)
    state = checkpoint.load(display.line) if options.resume and folder.has_begun else None
    # A run that began with kept snapshots goes on keeping them, or its films would have gaps.
    keep = (
        options.keep_snapshots or options.films > 0 or (state or {}).get("keeps_snapshots", False)
    )
    keys = RunKeys(folder.name, replay.run_id)
    clock = RunClock()
    phases = Phases(config, clock, options.steps)
    registry = ActorRegistry(transport, keys)
    evaluation = EvaluationCoordinator(
        Snapshots(folder.snapshots, keep=keep),
        config.protocol,
        evaluators=lambda: registry.alive("evaluator"),
        seconds=clock.seconds,
        join=join_command(options),
    )
    held_out = HeldOut(folder.held_out, config, algorithm, replay)
    telemetry = Telemetry(
        config,
        _constants(options, folder, device, page),
        phases,
        registry,
        held_out,
        EpochTable(folder.epochs),
        _sinks(options, folder, transport, keys, display, more_sinks),
        LiveFeed(transport, keys),
        clock.now,
        gpu=device.figures,
    )
    learner = Learner(
        config=config,
        replay=replay,
        algorithm=algorithm,
        draw=partial(
            Prefetcher,
            replay,
            lambda batch, ahead: algorithm.prepare(to_device(batch, device.torch), ahead=ahead),
            config.learning.batch_size,
        ),
        broadcast=Broadcast(
            algorithm, replay.run_id, transport.publisher(keys.weights).publish, sign, clock.now
        ),
        checkpoint=checkpoint,
        phases=phases,
        losses=LossGuard(algorithm, replay, folder.checkpoint, telemetry.note),
        held_out=held_out,
        evaluation=evaluation,
        registry=registry,
        telemetry=telemetry,
        guard=HealthGuard(
            options.gate_minutes,
            options.stall_minutes,
            config.stream.chunk_steps,
            force=options.force,
            warn=telemetry.say,
            now=clock.now,
        ),
        clock=clock,
        stop=stop,
    )
    rows, resumed_at = 0, None
    if state is not None:
        with checkpoint.restoring():
            learner.restore(state)
            rows, resumed_at = int(state["rows"]), phases.agent_steps
    serve_evaluators(transport, keys, evaluation, sign)
    telemetry.start(rows, resumed_at)  # at last: what it opens, only the learner's user closes
    return learner


def _constants(
    options: LearnerOptions, folder: RunFolder, device: Device, page: str | None
) -> Values:
    """Returns the figures that stay the same as long as this process works."""
    begun = DemonstrationsRecord.of(folder)
    return {
        **clock_figures(options),
        "run/run": folder.name,
        "run/device": device.name,
        "run/initial": _given(folder),
        "run/demonstrations": 0 if begun is None else begun.steps,
        "run/steps_goal": options.steps,
        "run/join": None if options.local else join_command(options),
        "run/page": page,
    }


def _given(folder: RunFolder) -> str | None:
    """Returns the identity of the network that the run began with; None for fresh weights."""
    if not folder.initial.exists():
        return None
    return copied_from(folder.initial) or "unknown"


def _sinks(
    options: LearnerOptions,
    folder: RunFolder,
    transport: Transport,
    keys: RunKeys,
    display: Display,
    more: Sequence[Sink],
) -> list[Sink]:
    """Returns all that takes the run's figures."""
    settings = flat(options.config)
    sinks: list[Sink] = [
        display,
        TensorBoardSink(folder.tensorboard, settings),
        GatesCsvSink(folder.gates),
        SummarySink(folder.summary, options.config, provenance()),
        ServiceManagerSink(),
        StatusSink(transport, keys),
        *more,
    ]
    if options.track is not None:
        tracked = TrackedRun(folder.name, replay_of(keys.run_id), settings)
        sinks.append(TrackerSink(options.track, tracked))
    if options.films:
        # First in the list, so that it closes last films before the sinks that receive them close.
        epsilon = options.config.exploration.start
        sinks.insert(0, FilmsSink(folder, options.films, epsilon, others=sinks.copy()))
    return sinks
