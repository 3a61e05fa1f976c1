"""`LaunchOptions`: what a run consists of, the same for every engine."""

import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Annotated, Literal

import tyro
from annotated_types import Ge, Gt, Le

from common.checked import Count, FromOne
from common.errors import InputError
from common.process.command_line import parse_run
from common.run.clock import ClockConfig
from common.run.folder import JOURNAL, RunFolder
from common.run.presets import PRESETS
from common.run.stored_config import flag_of, flat
from common.transport.access_control import MOST_SESSIONS
from learner.options import MOST_THREADS, LearnerOptions, resume_flags, run_name, stored_config

_SET_HERE = ("listen", "connect", "certificates", "local", "resume", "actors", "envs", "evaluators")
"""Fields of the learner that the engine sets."""
_OF_THE_REPLAY = ("actor_quota", "log_json", "restart")
"""Fields of the learner that a replay of its own has too, beside the run's settings."""


@dataclass(frozen=True)
class LaunchOptions:
    """Launch a run on an engine: write what it needs into the run's folder; Ray starts at once.

    What follows `--` are flags of `ale-robot train`.
    """

    engine: tyro.conf.Positional[Literal["slurm", "kubernetes", "compose", "ray"]]
    """Engine that runs it."""
    run: str | None = None
    """Name of the run; by default made of environment, game and preset."""
    runs: Path = Path("runs")
    """Folder that holds the runs; all nodes of Slurm or Ray must share it."""
    actors: Annotated[int, Ge(1), Le(MOST_SESSIONS)] = 2
    """Number of training actors, each a process with one core."""
    max_actors: Annotated[int, Ge(0), Le(MOST_SESSIONS)] = 0
    """Number of actors up to which Kubernetes may go while all are busy; 0 for no more."""
    evaluators: Annotated[int, Ge(0), Le(MOST_SESSIONS)] = 1
    """Number of evaluators, each a process with one core."""
    clock: tyro.conf.OmitArgPrefixes[ClockConfig] = field(default_factory=ClockConfig)
    cpus: Annotated[int, Ge(1), Le(MOST_THREADS)] = 4
    """Processor cores of the learner."""
    gpus: Count = 0
    """GPUs of the learner; it uses at most one."""
    memory: FromOne = 16
    """Memory of the learner, GiB."""
    actor_memory: FromOne = 2
    """Memory of each actor and evaluator, GiB."""
    replay: bool = False
    """Give the replay a process of its own, which learner and actors join; by default the learner
    hosts it."""
    replay_cpus: FromOne = 2
    """Processor cores of the replay of --replay."""
    replay_memory: FromOne = 8
    """Memory of the replay of --replay, GiB, the page cache of its file included."""
    tls: bool = True
    """Certificates between all processes; --no-tls is for a network whose machines you trust.
    Compose has none: its network is of the run alone."""
    patience: Annotated[float, Gt(0)] = 600.0
    """Seconds that actors keep their cores while the learner is away."""
    time: str = "24:00:00"
    """Time limit of each job of Slurm; at its end the job goes on in a new one."""
    partition: str | None = None
    """Partition of Slurm."""
    account: str | None = None
    """Account that the jobs of Slurm are charged to."""
    submit: bool = False
    """Submit the jobs to Slurm too."""
    address: str = "auto"
    """Address of the Ray cluster, as HOST:PORT; 'auto' takes RAY_ADDRESS, or the cluster of which
    this machine is a node."""
    stop: bool = False
    """End the run on Ray, with a checkpoint."""
    wait: bool = False
    """Wait until the run on Ray is over, and exit with the learner's exit code; Ctrl-C ends the
    run, with a checkpoint."""
    image: str = "ale-robot:latest"
    """Image of the containers, which deploy/Containerfile makes, as NAME:TAG."""

    def check(self) -> None:
        """Refuses what would be more than a word in a script. Raises InputError."""
        for flag in ("time", "partition", "account"):
            word = getattr(self, flag)
            if word is not None and not re.fullmatch(r"[A-Za-z0-9][\w.:-]*", word):
                raise InputError(f"--{flag} {word!r} cannot be used: write one word.")
        if not re.fullmatch(r"[\w.:/-]+:[\w.-]+", self.image):
            raise InputError(f"--image {self.image!r} is no image: write it as NAME:TAG.")


Module = Literal["learner", "replay", "actors"]


@dataclass(frozen=True)
class Program:
    """A process that begins its part of a run, or goes on with that."""

    module: Module
    begun: str
    """What is in the run's folder once it is to go on."""
    begin: list[str]
    """Flags that begin it."""
    resume: list[str]
    """Flags that go on with it."""
    kept: str
    """What it writes anew in the run's folder as it gets on."""


@dataclass(frozen=True)
class RunDescription:
    """A run that is about to be launched, checked as its learner would."""

    options: LaunchOptions
    folder: RunFolder
    flags: tuple[str, ...]
    """Flags of the learner, by the user."""
    learner: LearnerOptions
    """What they mean."""

    @property
    def hub(self) -> Module:
        """Which of the run's processes is its hub."""
        return "replay" if self.options.replay else "learner"

    def learner_program(self, runs: str, *own: str) -> Program:
        """Returns the learner, which has its folder in ``runs`` and ``own`` flags of the engine."""
        begin = ["--run", self.folder.name, "--runs", runs, *own, *self.flags]
        kept = self.folder.checkpoint.name
        if self.options.replay:
            begin += ["--patience", "inf"]
            # One that was ended while it waited for the replay has its settings, and nothing else:
            # so what the run begins with is told again.
            return Program(
                "learner", self.folder.config_file.name, begin, [*begin, "--resume"], kept
            )
        resume = resume_flags(begin, self.folder.name, done=False)
        force = ["--force"] if self.learner.force else []
        return Program("learner", self.folder.replay.name, begin, [*resume, *force], kept)

    def replay_program(self, runs: str, *own: str) -> Program:
        """Returns a replay of its own, with the settings that the learner's flags mean."""
        config, usual = self.learner.config, LearnerOptions(self.learner.config)
        preset = flat(PRESETS[config.preset])
        told = {name: value for name, value in flat(config).items() if value != preset[name]}
        for name in _OF_THE_REPLAY:
            if (value := getattr(self.learner, name)) != getattr(usual, name):
                told[name] = value
        settings = chain.from_iterable(flag_of(name, value) for name, value in told.items())
        begin = [
            *("--run", self.folder.name, "--runs", runs, *own),
            *("--preset", config.preset, *settings),
        ]
        ring = self.folder.replay.name
        return Program("replay", ring, begin, [*begin, "--resume"], f"{ring}/{JOURNAL}")

    def actor(self) -> list[str]:
        """Returns the flags of an actor, but who it is and where the hub is."""
        patience = f"{self.options.patience:g}"
        return ["--run", self.folder.name, "--patience", patience, *self.options.clock.flags()]


def describe(options: LaunchOptions, flags: Sequence[str]) -> RunDescription:
    """Returns the run of ``options`` whose learner has ``flags``. Raises InputError if the learner
    would refuse the flags, or the engine sets them."""
    options.check()
    runs = options.runs.absolute()
    own = [*(("--run", options.run) if options.run is not None else ()), "--runs", str(runs)]
    learner, _ = parse_run(LearnerOptions, "learner", [*own, *flags], stored_config)
    learner.check()
    default = LearnerOptions(learner.config)
    for name in _SET_HERE:
        if getattr(learner, name) != getattr(default, name):
            raise InputError(f"--{name} is the launcher's: omit it after `--`.")
    if learner.runs != runs or (options.run is not None and learner.run != options.run):
        raise InputError("--run and --runs are the launcher's: write them before `--`.")
    options.clock.check(learner.config.env)
    folder = RunFolder(runs, run_name(learner))
    for path in (folder.path, Path(sys.executable)):
        if not re.fullmatch(r"[\w./+-]+", str(path)):
            raise InputError(f"{path} cannot be written into a job: use letters, digits and ./+-_.")
    return RunDescription(options, folder, tuple(flags), learner)
