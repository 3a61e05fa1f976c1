"""`LaunchOptions`: the processes of a run and their resources, the same for every engine."""

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
from common.command_line.run_options import parse_run
from common.errors import InputError
from common.run.folder import JOURNAL, RUNS, RunFolder
from common.settings.clock import ClockConfig
from common.settings.presets import PRESETS
from common.settings.stored_config import flag_of, flat
from common.transport.access_control import MAX_SESSIONS
from common.transport.leaky_bucket import ACTOR_QUOTA
from learner.options import MAX_THREADS, LearnerOptions, run_name, stored_config
from learner.resume import resume_flags

_SET_HERE = ("listen", "connect", "certificates", "local", "resume", "actors", "envs", "evaluators")
"""Options of the learner that the launcher sets."""
_OF_THE_REPLAY = ("actor_quota", "log_json", "restart")
"""Options of the learner that a separate replay gets too, beside the run's settings."""


@dataclass(frozen=True)
class LaunchOptions:
    """Launch a run: write the engine's files into its folder, or start it on Ray.

    Flags after `--` are those of `ale-robot train`.
    """

    engine: tyro.conf.Positional[Literal["slurm", "kubernetes", "compose", "ray"]]
    """Engine that runs the processes."""
    run: str | None = None
    """Name of the run; by default it is made of environment, game and preset."""
    runs: Path = RUNS
    """Folder that holds the runs; all nodes of Slurm or Ray must share it."""
    actors: Annotated[int, Ge(1), Le(MAX_SESSIONS)] = 2
    """Number of training actors; each is a process with one core."""
    max_actors: Annotated[int, Ge(0), Le(MAX_SESSIONS)] = 0
    """Maximum number of actors to which Kubernetes may scale while all are busy; 0 for no
    scaling."""
    evaluators: Annotated[int, Ge(0), Le(MAX_SESSIONS)] = 1
    """Number of evaluators; each is a process with one core."""
    clock: tyro.conf.OmitArgPrefixes[ClockConfig] = field(default_factory=ClockConfig)
    cpus: Annotated[int, Ge(1), Le(MAX_THREADS)] = 4
    """Number of processor cores of the learner."""
    gpus: Count = 0
    """Number of GPUs of the learner, which uses at most one."""
    memory: FromOne = 16
    """Memory of the learner, GiB."""
    actor_memory: FromOne = 2
    """Memory of each actor and evaluator, GiB."""
    replay: bool = False
    """Run the replay as a process of its own, which learner and actors join; by default the learner
    hosts it."""
    replay_cpus: FromOne = 2
    """Number of processor cores of the replay, with --replay."""
    replay_memory: FromOne = 8
    """Memory of the replay, with --replay, GiB; it includes the page cache of the replay's file."""
    tls: bool = True
    """Certificates between all processes; --no-tls is for a network whose machines you trust.
    Compose uses none, because its network belongs to the run alone."""
    patience: Annotated[float, Gt(0)] = 600.0
    """Time that actors wait, and keep their cores, while the learner is away, seconds."""
    time: str = "24:00:00"
    """Time limit of each Slurm job, such as 90 (minutes), 24:00:00 or 2-12 (days and hours); at its
    end a new job continues the work."""
    partition: str | None = None
    """Slurm partition."""
    account: str | None = None
    """Account to which the Slurm jobs are charged."""
    submit: bool = False
    """Submit the jobs to Slurm as well."""
    address: str = "auto"
    """Address of the Ray cluster, HOST:PORT; 'auto' uses RAY_ADDRESS, or the cluster that this
    machine is a node of."""
    stop: bool = False
    """End the run on Ray, with a checkpoint."""
    wait: bool = False
    """Wait until the run on Ray is over, and exit with the learner's exit code; Ctrl-C ends the
    run, with a checkpoint."""
    image: str = "ale-robot:latest"
    """Image of the containers, NAME:TAG; deploy/Containerfile builds it."""

    def check(self) -> None:
        """Checks the options that go into scripts. Raises InputError if one is more than a word, or
        not of its format."""
        if not re.fullmatch(r"[0-9]+(-[0-9]+)?(:[0-9]+){0,2}", self.time):
            raise InputError(
                f"--time {self.time!r} is not a time of Slurm's: write minutes, or "
                "HOURS:MINUTES:SECONDS or DAYS-HOURS."
            )
        for flag in ("partition", "account"):
            word = getattr(self, flag)
            if word is not None and not re.fullmatch(r"[A-Za-z0-9][\w.:-]*", word):
                raise InputError(f"--{flag} {word!r} cannot be used: write one word.")
        if not re.fullmatch(r"[\w.:/-]+:[\w.-]+", self.image):
            raise InputError(f"--image {self.image!r} is not an image: write it as NAME:TAG.")


Module = Literal["learner", "replay", "actors"]


@dataclass(frozen=True)
class Program:
    """A process of a run, and how it is begun or resumed."""

    module: Module
    begun: str
    """File or folder in the run's folder; if it exists, the process is resumed."""
    begin: list[str]
    """Flags that begin it."""
    resume: list[str]
    """Flags that resume it."""
    kept: str
    """File in the run's folder that it rewrites as it makes progress."""


@dataclass(frozen=True)
class RunDescription:
    """A run that is about to be launched, checked as its learner would check it."""

    options: LaunchOptions
    folder: RunFolder
    flags: tuple[str, ...]
    """The user's flags of the learner."""
    learner: LearnerOptions
    """The same flags, parsed."""

    @property
    def hub(self) -> Module:
        """The process that is the run's hub."""
        return "replay" if self.options.replay else "learner"

    def learner_program(self, runs: str, *own: str) -> Program:
        """Returns the learner's program, with the runs in ``runs`` and the engine's ``own``
        flags."""
        begin = ["--run", self.folder.name, "--runs", runs, *own, *self.flags]
        kept = self.folder.checkpoint.name
        if self.options.replay:
            begin += ["--patience", "inf"]
            if self.learner.actor_quota != ACTOR_QUOTA:  # which the replay has
                begin += ["--actor-quota", f"{ACTOR_QUOTA}"]
            # A learner that was ended while it waited for the replay has stored its settings and
            # nothing else, so the flags that begin the run are given again.
            return Program(
                "learner", self.folder.config_file.name, begin, [*begin, "--resume"], kept
            )
        resume = resume_flags(begin, self.folder.name, done=False)
        force = ["--force"] if self.learner.force else []
        return Program("learner", self.folder.replay.name, begin, [*resume, *force], kept)

    def replay_program(self, runs: str, *own: str) -> Program:
        """Returns the program of a separate replay, with the settings of the learner's flags."""
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
        """Returns the flags of an actor, except its name and the address of the hub."""
        patience = f"{self.options.patience:g}"
        return ["--run", self.folder.name, "--patience", patience, *self.options.clock.flags()]


def describe(options: LaunchOptions, flags: Sequence[str]) -> RunDescription:
    """Returns the run of ``options`` whose learner gets ``flags``. Raises InputError for flags that
    the learner would refuse or that the launcher sets."""
    options.check()
    runs = options.runs.absolute()
    own = [*(("--run", options.run) if options.run is not None else ()), "--runs", str(runs)]
    learner = parse_run(LearnerOptions, "learner", [*own, *flags], stored_config)
    default = LearnerOptions(learner.config)
    for name in _SET_HERE:
        if getattr(learner, name) != getattr(default, name):
            raise InputError(f"--{name} is set by the launcher: omit it after `--`.")
    learner.check()
    if learner.runs != runs or (options.run is not None and learner.run != options.run):
        raise InputError("--run and --runs are flags of the launcher: write them before `--`.")
    options.clock.check(learner.config.env)
    if learner.cuda_graphs and not options.gpus:
        raise InputError("--cuda-graphs needs a GPU: write --gpus 1 before `--`.")
    folder = RunFolder(runs, run_name(learner))
    for path in (folder.path, Path(sys.executable)):
        if not re.fullmatch(r"[\w./+-]+", str(path)):
            raise InputError(f"{path} cannot be written into a job: use letters, digits and ./+-_.")
    return RunDescription(options, folder, tuple(flags), learner)
