"""`python -m learner`: trains the run's network, and hosts its replay and hub."""

import os
import shlex
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import torch
import tyro

from common.errors import InputError, exit_on_input_error
from common.metrics import Value
from common.network import QNetwork, build_network
from common.process.allocator import keep_large_blocks
from common.process.command_line import RunFlags, parse_run
from common.process.lifeline import on_signals
from common.process.threads import end_with_any_thread
from common.protocol.weights import encode_weights, load_weights_file
from common.run.clock import ClockConfig
from common.run.config import RunConfig, differences
from common.run.folder import RunFolder, write_atomically
from common.run.join import find_run
from common.run.origin import origin_of
from common.transport.endpoint import DEFAULT_ENDPOINT, from_here
from common.transport.interface import Transport
from common.transport.zenoh_transport import connect, open_hub
from learner.algorithm.registry import build_algorithm
from learner.assembly import build_learner
from learner.device import DeviceChoice, PrecisionChoice, choose_device
from learner.evaluation.offline import EvaluationOptions, evaluate
from learner.health_guard import STALL_MINUTES
from learner.local_launcher import launch
from learner.telemetry.gate import EXIT_CODE, MINUTES
from learner.telemetry.sinks.display import open_display
from replay.client import RemoteReplay
from replay.interface import Replay
from replay.replay_buffer import ReplayBuffer
from replay.server import ReplayServer


@dataclass(frozen=True)
class LearnerOptions:
    """Train a network from what the actors live through, and send them its weights.

    Hosts the run's replay and hub unless --connect names a replay of its own. Actors join from
    other terminals or machines by `python -m actors --sync`; with --local they are started here.
    """

    config: RunFlags
    run: str | None = None
    """Name of the run; by default made of environment, game and preset."""
    runs: Path = Path("runs")
    """Folder that holds the runs."""
    resume: bool = False
    """Go on with the run that is there, under its own settings."""
    initial: Path | None = None
    """Begin with this network, such as policies/ale_pong.safetensors, instead of a fresh one;
    --exploration.start then says how much of its play is random at first."""
    steps: int | None = None
    """End by itself after so many agent steps, the warm-up included."""
    local: bool = False
    """Start actors and an evaluator on this machine, and end them with the learner."""
    actors: int = 1
    """Training actors of local mode."""
    envs: int = 1
    """Environments in each actor of local mode."""
    evaluators: int = 1
    """Evaluators of local mode."""
    clock: tyro.conf.OmitArgPrefixes[ClockConfig] = field(default_factory=ClockConfig)
    device: DeviceChoice = "auto"
    """Hardware of the learner; 'auto' takes CUDA where there is one."""
    precision: PrecisionChoice = "auto"
    """Of the network's arithmetic; 'auto' takes bfloat16 where the hardware is made for it."""
    threads: int = 0
    """Processor threads of an update; 0 for as many cores as local mode's actors leave free, or
    half of them when actors may run in other terminals."""
    listen: str = DEFAULT_ENDPOINT
    """Address where actors find this process; name 0.0.0.0 to let other machines in."""
    connect: str | None = None
    """Address of a `python -m replay` to use instead of a replay of one's own."""
    patience: float = 60.0
    """Seconds to wait for that replay."""
    certificates: Path | None = None
    """Folder of certificates, where the address begins with tls/; see deploy/README.md."""
    gate_minutes: float = MINUTES
    """Minutes that a gate may be red before the run ends by itself, with exit code 3."""
    stall_minutes: float = STALL_MINUTES
    """Minutes without any agent step or update after which the run ends by itself, with exit code
    3; inf to wait for ever."""
    force: bool = False
    """Train on though a gate stays red or nothing happens; only warn."""
    evaluation: tyro.conf.OmitArgPrefixes[EvaluationOptions] = field(
        default_factory=EvaluationOptions
    )

    def check(self) -> None:
        self.evaluation.check()
        for name, value, least in (
            ("--actors", self.actors, 1),
            ("--envs", self.envs, 1),
            ("--evaluators", self.evaluators, 0),
            ("--threads", self.threads, 0),
        ):
            if value < least:
                raise InputError(f"{name} is {value}: choose {least} or more.")
        self.clock.check(self.config.env)
        if not 0 < self.gate_minutes < float("inf"):
            raise InputError(
                f"--gate-minutes is {self.gate_minutes}: choose a number above 0, or --force."
            )
        if not self.stall_minutes > 0:
            raise InputError(
                f"--stall-minutes is {self.stall_minutes}: choose a number above 0, or inf."
            )
        if self.initial is not None and self.resume:
            raise InputError("a run that goes on has a network: leave --initial or --resume away.")
        if self.evaluation.evaluate is not None:
            return  # the games' own processes check the rest
        if (flag := self.clock.robot_flag) and not self.local:
            raise InputError(f"{flag} is for --local: give it to each `python -m actors`.")
        if self.steps is not None and self.steps <= self.config.replay.learning_starts:
            raise InputError(
                f"--steps is {self.steps}, all of which the warm-up of "
                f"{self.config.replay.learning_starts} takes: choose more, or lower "
                "--replay.learning-starts."
            )


def run_name(options: LearnerOptions) -> str:
    config = options.config
    return options.run or f"{config.env}-{config.game}-{config.preset}".replace("_", "-")


def stored_config(options: LearnerOptions) -> RunConfig | None:
    """Of the run to resume, or of that which trained the network to evaluate."""
    if options.evaluation.evaluate is not None:
        return origin_of(options.evaluation.evaluate)
    if options.resume:
        return RunFolder(options.runs, run_name(options)).stored_config()
    return None


@contextmanager
def hosted_replay(
    options: LearnerOptions, config: RunConfig, folder: RunFolder, actions: int
) -> Iterator[tuple[Transport, Replay, str]]:
    """Hub and replay in this process; also the address at which they are found."""
    folder.claim("replay", config, begun=folder.replay, resume=options.resume)
    with open_hub(options.listen, options.certificates) as transport:
        memory = ReplayBuffer(config, folder.replay, actions)
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
    with connect(
        endpoint,
        options.patience,
        stop.is_set,
        role="learner",
        certificates=options.certificates,
    ) as transport:
        keys, config = find_run(transport, folder.name, options.patience, stop.is_set)
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


def first_network(options: LearnerOptions, folder: RunFolder) -> QNetwork:
    """The network that a run begins with; one that has a checkpoint takes its weights from there.

    Raises:
        InputError: it cannot be read, or is not for what the run plays.
    """
    network = build_network(options.config, options.config.action_count)
    initial = options.initial
    if options.resume and not folder.checkpoint.exists() and folder.initial.exists():
        initial = folder.initial  # it ended before its first checkpoint
    if initial is not None:
        trained = origin_of(initial)
        unlike = [] if trained is None else differences(trained, options.config)
        of_play = "; ".join(each for each in unlike if each.startswith("play."))
        load_weights_file(
            network,
            initial,
            "this run",
            "give the run the settings of play under which the network was trained"
            + (f" ({of_play})" if of_play else ""),
        )
    return network


def certificate_flags(options: LearnerOptions) -> list[str]:
    """By which local mode's actors find theirs."""
    folder = options.certificates
    return [] if folder is None else ["--certificates", str(folder)]


def clock_figures(options: LearnerOptions) -> dict[str, Value]:
    """Returns how time passes, for the run's records; nothing where actors start elsewhere."""
    return {f"run/{name}": value for name, value in vars(options.clock).items() if options.local}


def free_cores(options: LearnerOptions) -> int:
    """Cores for the update: those that actors here leave free.

    Threads that share a core wait for each other at every layer: two on two busy cores are far
    slower than one alone (benchmarks/LOG.md).
    """
    cores = len(os.sched_getaffinity(0))
    return max(cores - options.actors if options.local else cores // 2, 1)


def going_on(arguments: Sequence[str], run: str, *, done: bool) -> str:
    """The command that goes on with a run which was started with ``arguments``.

    Args:
        done: whether it has all the steps it was asked for.
    """
    told: list[str] = []
    left_away = {"--initial", *(["--steps"] if done else [])}
    skip = False
    for argument in arguments:
        name, equals, _ = argument.partition("=")
        if not skip and name not in {*left_away, "--force"}:
            told.append(argument)
        skip = name in left_away and not equals
    flags = {argument.partition("=")[0] for argument in told}
    more = [] if "--run" in flags else ["--run", run]
    more += [] if "--resume" in flags else ["--resume"]
    return shlex.join(["python", "-m", "learner", *told, *more])


def main() -> int:
    options = parse_run(LearnerOptions, "learner", sys.argv[1:], stored_config)
    options.check()
    if options.evaluation.evaluate is not None:
        stop = threading.Event()
        on_signals(stop)
        return evaluate(options.evaluation, options.config, options.clock.flags(), stop)
    config = options.config
    folder = RunFolder(options.runs, run_name(options))
    network = first_network(options, folder)
    device = choose_device(options.device, options.precision)
    algorithm = build_algorithm(config, network, device)
    keep_large_blocks()
    torch.set_num_threads(options.threads or free_cores(options))
    stop = threading.Event()
    on_signals(stop)
    folder.claim("learner", config, begun=folder.checkpoint, resume=options.resume)
    if options.initial is not None:
        write_atomically(folder.initial, encode_weights(network))
    elif not options.resume:
        folder.initial.unlink(missing_ok=True)  # of a start that failed
    place = (
        hosted_replay(options, config, folder, network.action_count)
        if options.connect is None
        else remote_replay(options, options.connect, folder, stop)
    )
    with (
        end_with_any_thread(stop),
        place as (transport, replay, endpoint),
        open_display() as display,
        ExitStack() as stack,
    ):
        learner = build_learner(
            *(transport, config, folder, replay, algorithm, device, display),
            steps_goal=options.steps,
            resume=options.resume and folder.checkpoint.exists(),
            clock_mode=clock_figures(options),
            gate_minutes=options.gate_minutes,
            stall_minutes=options.stall_minutes,
            force=options.force,
            stop=stop,
        )
        learner.start()
        children = None
        if options.local:
            children = launch(
                *(from_here(endpoint), folder.name),
                *(options.actors, options.envs, options.evaluators),
                folder.path / "logs",
                [*options.clock.flags(), *certificate_flags(options)],
                low_priority=options.clock.sync,
            )
            stack.callback(children.close)
        display.line(
            f"run {folder.name} in {folder.path}: {config.game} ({config.env}), preset "
            f"{config.preset}, on {device.name}; actors find it at {endpoint}."
        )
        learner.run(children)
    again = going_on(sys.argv[1:], folder.name, done=learner.done)
    if learner.failed is not None:
        print(
            f"stopped: {learner.failed}. Everything is in {folder.path}; mend what is wrong, or "
            f"train on regardless with: {again} --force",
            file=sys.stderr,
        )
        return EXIT_CODE
    print(f"Everything is in {folder.path}; go on with: {again}")
    return 0


if __name__ == "__main__":
    exit_on_input_error(main)
