"""The learner's command line: its flags, what they mean together, and the command to continue."""

import shlex
from dataclasses import dataclass, field, replace
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from annotated_types import Ge, Gt, Le
from pydantic import AllowInfNan

from common.checked import Amount, Count, Patience
from common.command_line.run_options import RunOptions
from common.endpoint import DEFAULT_ENDPOINT, check_endpoint, from_here
from common.errors import InputError
from common.metrics import Value
from common.native.kernel import KernelChoice, PrecisionChoice
from common.process.cores import usable_cores
from common.process.extras import check_extra
from common.process.http_endpoints import check_address
from common.process.log_lines import LOADING
from common.registry import ALGORITHMS, SAMPLERS
from common.run.folder import Part, RunFolder
from common.settings.clock import ClockConfig
from common.settings.config import MAX_ENVS, RunConfig
from common.settings.presets import PRESETS
from common.settings.ranges import NOTHING_DRAWN
from common.transport.access_control import MAX_SESSIONS
from common.transport.credentials import check_certificates
from learner.device import DeviceChoice
from learner.telemetry.sinks.tracker import TRACKERS

MAX_THREADS = 1_024


@dataclass(frozen=True)
class LearnerOptions(RunOptions):
    """Train a network on the actors' transitions, and send them its weights.

    The learner hosts the run's replay and hub, unless --connect names a replay in another process.
    Actors join from other terminals or machines with `ale-robot join`; with --local they are
    started here. `ale-robot status` shows how a run is doing, and `ale-robot evaluate` how well its
    network plays.
    """

    ELSEWHERE: ClassVar = {
        **dict.fromkeys(
            ("--games", "--headline", "--json", "--processes"),
            "is for an evaluation, `ale-robot evaluate`: omit it",
        ),
        "--epsilon": "is for an evaluation: give --exploration.end or --protocol.test-epsilon",
        "--test-steps": "is for an evaluation: give --protocol.test-steps",
    }

    run: str | None = None
    """Name of the run; by default made of environment, game and preset."""
    demonstrations: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None
    """Recorded games, from `ale-robot record` or `human --record`, with which the replay begins.
    They count as steps of the run."""
    steps: Count | None = None
    """Agent steps, including the warm-up, after which the run ends. Those under way by then count
    too: of each actor up to --stream.window chunks, and of each environment the one begun."""
    keep_snapshots: bool = False
    """Keep each epoch's weights in the run's snapshots/ as epoch-0001.safetensors and so on, 1 to 7
    MB each; a resumed run goes on keeping them. epochs.csv has their wall clock and steps."""
    films: Amount = 0.0
    """Seconds of each film; 0 for no films. The run's films/ gets one of the warm-up's random play
    and one of each epoch's network, as far as there is time to make them: epoch-0000.mp4,
    epoch-0001.mp4 and so on. Keeps each epoch's weights too."""
    local: bool = False
    """Local mode: start actors and evaluators on this machine, and end them with the learner.
    `ale-robot train` gives this flag."""
    actors: Annotated[int, Ge(1), Le(MAX_SESSIONS)] = 1
    """Number of training actors, in local mode."""
    envs: Annotated[int, Ge(1), Le(MAX_ENVS)] = 1
    """Number of environments in each actor, in local mode."""
    evaluators: Annotated[int, Ge(0), Le(MAX_SESSIONS)] = 1
    """Number of evaluators, in local mode."""
    clock: tyro.conf.OmitArgPrefixes[ClockConfig] = field(default_factory=ClockConfig)
    device: DeviceChoice = "auto"
    """Hardware of the learner; 'auto' takes CUDA if it is available."""
    precision: PrecisionChoice = "auto"
    """Precision of the updates, and of local mode's actors by the native kernel; 'auto' takes
    bfloat16 if the hardware multiplies it faster. Where it is only emulated, bfloat16 is far slower
    than float32."""
    kernel: KernelChoice = "auto"
    """Code of an update on a CPU, and of local mode's actors: 'torch', or 'native', which g++ or
    clang compiles here once; 'auto' takes what is faster."""
    cuda_graphs: bool = False
    """Record an update once as a CUDA graph, and launch it as a whole from then on. Needs a
    CUDA device."""
    threads: Annotated[int, Ge(0), Le(MAX_THREADS)] = 0
    """Processor threads of an update; 0 for as many cores as local mode's actors leave free, or
    half of the cores if actors may run in other terminals."""
    connect: str | None = None
    """Address of a `python -m replay` to use instead of a replay in this process."""
    patience: Patience = 60.0
    """Seconds to wait for the replay at --connect."""
    web: str | None = None
    """Address of a web page that shows the run, such as 127.0.0.1:8080; by default there is no
    page."""
    track: str | None = None
    """Experiment tracker that gets curves, histograms and films: 'wandb', 'mlflow', 'trackio' or a
    registered one. Its own settings, such as WANDB_MODE=offline, decide where it keeps them."""
    gate_minutes: Annotated[float, Gt(0)] = 5.0
    """Minutes that a health check may be red before the run ends with exit code 3."""
    stall_minutes: Annotated[float, Gt(0), AllowInfNan(True)] = 10.0
    """Minutes without an agent step or update after which the run ends with exit code 3; inf waits
    for ever."""
    force: bool = False
    """Only warn, and train on, if a health check stays red or no progress is made."""

    @property
    def folder(self) -> RunFolder:
        """The run's folder."""
        return RunFolder(self.runs, run_name(self))

    def check(self) -> None:
        """Refuses flags that do not go together.

        Raises:
            InputError: it names the flags.
        """
        check_endpoint(self.connect or self.listen)
        if self.http is not None:
            check_address(self.http)
        if self.web is not None:
            web_address(self.web)
        self.clock.check(self.config.env, self.envs)
        if (flag := self.clock.robot_flag) and not self.local:
            raise InputError(f"{flag} is for --local: give it to each `python -m actors`.")
        self._refuse_ignored()
        if self.steps is not None and self.steps <= self.config.replay.learning_starts:
            lower = "" if self.resume else ", or lower --replay.learning-starts"
            raise InputError(
                f"--steps is {self.steps:,}, no more than the warm-up of "
                f"{self.config.replay.learning_starts:,}: choose more{lower}."
            )
        steps = self.config.learning.curriculum_steps
        if steps and self.config.randomise == NOTHING_DRAWN:
            raise InputError(
                f"--learning.curriculum-steps is {steps}, but there is no range that it could "
                "widen: give one of --randomise, or --randomise.all."
            )
        if self.config.learning.curriculum_score is not None and not steps:
            raise InputError(
                "--learning.curriculum-score judges a curriculum: give its "
                "--learning.curriculum-steps too."
            )
        if not self.resume:  # the settings of a resumed run are fixed
            self._refuse_settings_without_effect()

    def check_here(self) -> None:
        """Refuses flags whose packages or certificates this machine lacks, or that do not suit the
        run's folder.

        `check` leaves this out, because the machine that launches a run may lack all of them.

        Raises:
            InputError: it names the flag.
        """
        # A resumed run has its recording already, or asks for the package when it reads it again.
        demonstrations = None if self.resume else self.demonstrations
        for flag, given, extra in (
            ("--demonstrations", demonstrations, "record"),
            ("--http", self.http, "ops"),
            ("--web", self.web, "web"),
            (f"--track {self.track}", self.track, self.track and TRACKERS.find(self.track).extra),
        ):
            if given is not None and extra:
                check_extra(flag, extra)
        if self.local:
            actors, evaluators = local_names(self)
            for name in (*actors, *evaluators):
                check_certificates(self.connect or self.listen, self.certificates, "actor", name)
        folder = self.folder
        folder.check_place()
        parts: tuple[Part, ...] = ("learner",) if self.connect else ("learner", "replay")
        for part in parts:
            folder.check_claim(part, self.config, resume=self.resume)

    def _refuse_ignored(self) -> None:
        """Refuses flags that have no effect beside the others, or without them."""
        usual = LearnerOptions(self.config)
        joins = self.connect is not None
        for ignored, names, told in (
            (
                not self.local,
                ("actors", "envs", "evaluators"),
                "is for --local: omit it, and start actors by `ale-robot join`",
            ),
            (joins, ("listen",), "means nothing beside --connect: omit one of them"),
            (joins, ("actor_quota",), "is for the replay at --connect: give it to that"),
            (not joins, ("patience",), "is for a replay at --connect: omit it"),
        ):
            for name in names if ignored else ():
                if getattr(self, name) != getattr(usual, name):
                    raise InputError(f"--{name.replace('_', '-')} {told}.")

    def _refuse_settings_without_effect(self) -> None:
        """Refuses settings that mean nothing to the others, unless nobody gave them."""
        config, usual = self.config, self.defaults(PRESETS[self.config.preset])
        learning, sampler = config.learning, config.replay.sampler
        adam = learning.optimizer == "adam"
        for group, names, told in (
            (
                "learning",
                ALGORITHMS.find(learning.algorithm).ignores,
                f"means nothing to the algorithm {learning.algorithm}: omit it, or choose another "
                "--learning.algorithm",
            ),
            (
                "replay",
                SAMPLERS.find(sampler).ignores,
                f"means nothing to the sampler {sampler}: omit it, or choose another "
                "--replay.sampler",
            ),
            (
                "learning",
                ("rmsprop_decay",) if adam else (),
                "means nothing to Adam: omit it, or choose --learning.optimizer rmsprop",
            ),
            (
                "learning",
                () if learning.target == "double" else ("early_choice",),
                "means nothing without --learning.target double: omit it, or choose that",
            ),
            (
                "learning",
                () if learning.annealing_steps else ("final_learning_rate",),
                "means nothing without --learning.annealing-steps: give that, or omit it",
            ),
        ):
            for name in names:
                if attrgetter(f"{group}.{name}")(config) != attrgetter(f"{group}.{name}")(usual):
                    raise InputError(f"--{group}.{name.replace('_', '-')} {told}.")


web_address = partial(check_address, flag="--web", usual="127.0.0.1:8080", least_port=0)
"""Returns host and port of the page, see `check_address`; port 0 stands for any free port."""


def going_on(options: LearnerOptions) -> LearnerOptions:
    """Returns the options that continue the run; ``options`` themselves if it has not begun."""
    folder = options.folder
    if folder.stored_config() is None:
        return options
    # The run has its own copy of the network, and the file may have changed since.
    initial = None if folder.initial.exists() else options.initial
    return replace(options, resume=True, initial=initial)


def opening(options: LearnerOptions) -> str:
    """Returns the first line of a run; of a resumed run it says what is opened, which may take a
    minute."""
    folder = options.folder
    if not (options.resume and folder.has_begun):
        return LOADING
    replay = f"the replay at {options.connect}"
    if options.connect is None:
        size = sum(file.stat().st_size for file in folder.replay.glob("*"))
        replay = f"its replay ({size / 1e9:.2f} GB)"
    return f"going on with run {folder.name}: opening its checkpoint and {replay} ..."


def local_names(options: LearnerOptions) -> tuple[list[str], list[str]]:
    """Returns the names of local mode's actors, and those of its evaluators."""
    roles = (("actor", options.actors), ("evaluator", options.evaluators))
    actors, evaluators = ([f"{role}-{i}" for i in range(1, n + 1)] for role, n in roles)
    return actors, evaluators


def run_name(options: LearnerOptions) -> str:
    """Returns the given name of the run, or one made of environment, game and preset."""
    if options.run is not None:
        return options.run
    config = options.config
    task = () if config.task == config.env else (config.task,)
    return "-".join((config.env, *task, config.preset)).replace("_", "-")


def stored_config(options: LearnerOptions) -> RunConfig | None:
    """Returns the settings of the run to resume; None for a new one."""
    if options.resume:
        return options.folder.stored_config()
    return None


def clock_figures(options: LearnerOptions) -> dict[str, Value]:
    """Returns how time passes, for the run's records; nothing if actors are started elsewhere."""
    return {f"run/{name}": value for name, value in vars(options.clock).items() if options.local}


def join_command(options: LearnerOptions) -> str:
    """Returns the command that starts an actor of this run on this machine."""
    address = from_here(options.connect or options.listen)
    words = ["ale-robot", "join"]
    if address != DEFAULT_ENDPOINT:
        words += ["--connect", address]
    if (folder := options.certificates) is not None:
        # A learner's machine need not have the actors' certificates.
        words += ["--certificates", str(folder) if any(folder.glob("actor*.pem")) else "FOLDER"]
    return shlex.join(words)


def free_cores(options: LearnerOptions) -> int:
    """Returns the number of cores for the update: those that the actors here leave free.

    Threads that share a core wait for each other at every layer: two threads on two busy cores are
    far slower than one alone (benchmarks/LOG.md). An evaluator plays at lower priority, and only
    while there is a test.
    """
    cores = usable_cores()
    return max(cores - options.actors if options.local else cores // 2, 1)
