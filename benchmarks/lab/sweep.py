"""`python -m benchmarks.lab.sweep STUDY --vary …`: searches settings by trainings, with Optuna.

Each trial is a run of `python -m learner --local` with settings that the study draws. After each
epoch the study gets the mean score of the trial's training games. It ends a trial whose score is
below the median of the others at that epoch. The same command continues a study, and other flags
are refused. Each terminal that runs it is one worker, on one machine or on several that share a
``--storage``. A trial whose worker died is started again.
"""

import time
import warnings
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from math import isfinite
from shlex import join
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
import tyro
from annotated_types import MinLen

from benchmarks.child import free_endpoint
from benchmarks.lab.policy import TrainingOptions, scores_of
from benchmarks.report import Report, main
from common.checked import Count, FromOne
from common.command_line.run_options import parse_run
from common.errors import InputError
from common.process.extras import extra_for
from common.process.supervisor import Child
from common.protocol.run_keys import check_name
from common.run.epochs import EpochTable
from common.run.folder import RunFolder
from learner.options import LearnerOptions

if TYPE_CHECKING:
    from optuna import Study, Trial

_POLL = 1.0
_ALIVE = 60
"""Seconds between a worker's signs of life; after three times as long it counts as dead."""


class Axis(NamedTuple):
    """A setting that the study varies."""

    flag: str
    choices: tuple[str, ...] = ()
    """Values to try; if there are none, all values between two numbers."""
    low: float = 0.0
    high: float = 0.0
    log: bool = False
    whole: bool = False

    @classmethod
    def parse(cls, text: str) -> "Axis":
        """Reads ``FLAG=A,B,C``, ``FLAG=LOW:HIGH`` or ``FLAG=LOW:HIGH:log``.

        Between two whole numbers only whole numbers are drawn.

        Raises:
            InputError: ``text`` has another form.
        """
        flag, _, values = text.partition("=")
        parts = values.split(":")
        try:
            if not flag or not values or parts[2:] not in ([], ["log"]):
                raise ValueError
            if len(parts) == 1:
                return cls(flag.lstrip("-"), tuple(values.split(",")))
            low, high = map(float, parts[:2])
            if not (isfinite(low) and isfinite(high) and low < high and (low > 0 or not parts[2:])):
                raise ValueError
        except ValueError:
            raise InputError(
                f"--vary {text} names no settings to try: write it as learning.n-step=3,5,10 or "
                "learning.learning-rate=5e-5:1e-3:log."
            ) from None
        whole = all(part.strip().isdigit() for part in parts[:2])
        return cls(flag.lstrip("-"), low=low, high=high, log=bool(parts[2:]), whole=whole)

    @property
    def ends(self) -> Sequence[str]:
        """All choices, or both ends of what is between, as for the command line."""
        return self.choices or [self._told(self.low), self._told(self.high)]

    def draw(self, trial: "Trial") -> str:
        """Returns the value of ``trial``, as for the command line."""
        if self.choices:
            return str(trial.suggest_categorical(self.flag, self.choices))
        if self.whole:
            return f"{trial.suggest_int(self.flag, int(self.low), int(self.high), log=self.log)}"
        return self._told(trial.suggest_float(self.flag, self.low, self.high, log=self.log))

    def _told(self, value: float) -> str:
        return f"{int(value)}" if self.whole else f"{value:.6g}"


@dataclass(frozen=True, kw_only=True)
class Options(TrainingOptions):
    """Search settings by whole trainings; needs pip install 'ale-robot[sweep]'."""

    study: tyro.conf.Positional[str]
    """Name of the study."""
    vary: Annotated[tuple[str, ...], MinLen(1)] = tyro.MISSING
    """Settings to vary, each as FLAG=A,B,C or FLAG=LOW:HIGH or FLAG=LOW:HIGH:log."""
    trials: Count = 20
    """Number of trials of this worker."""
    steps: FromOne = 200_000
    """Length of a trial, in agent steps."""
    storage: str = ""
    """URL at which Optuna keeps the study; by default STUDY.db in the folder of the runs."""
    seed: Count = 1
    """Seed of the settings that are drawn, and of every trial's run."""

    def check(self) -> None:
        super().check()
        check_name("study", self.study)


def measure(options: Options) -> Report:
    axes = [Axis.parse(text) for text in options.vary]
    for axis in axes:
        for end in axis.ends:
            _check_training(options, [f"--{axis.flag}", end])
    with extra_for("python -m benchmarks.lab.sweep", "sweep"):
        import optuna
    warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)  # of the heartbeats
    options.runs.mkdir(parents=True, exist_ok=True)
    study = optuna.create_study(
        study_name=options.study,
        storage=optuna.storages.RDBStorage(
            options.storage or f"sqlite:///{options.runs / options.study}.db",
            heartbeat_interval=_ALIVE,
            heartbeat_stale_trial_callback=optuna.storages.RetryHeartbeatStaleTrialCallback(),
        ),
        direction="maximize",
        pruner=optuna.pruners.MedianPruner(n_startup_trials=4),
        load_if_exists=True,
    )
    _check_study(options, study)
    if options.trials:
        study.optimize(
            lambda trial: _play(options, axes, trial),
            n_trials=options.trials,
            catch=(InputError,),  # such as of a loss that diverges: the other trials go on
        )
    return _report(options, study)


def _check_training(options: Options, drawn: Sequence[str]) -> None:
    """Refuses settings that no trial could train with.

    Raises:
        InputError: a flag is unknown or out of its bounds, or a trial would end before its first
            epoch.
    """
    flags = ["--steps", f"{options.steps}", *options.learner_flags, *drawn]
    learner = parse_run(LearnerOptions, "learner", ["--local", *flags], lambda _: None)
    learner.check()
    config = learner.config
    first = config.replay.learning_starts + config.protocol.epoch_steps
    if options.steps < first:
        raise InputError(
            f"--steps is {options.steps}, but the first epoch ends after {first}: choose more, or "
            "lower --protocol.epoch-steps in --learner."
        )


def _check_study(options: Options, study: "Study") -> None:
    """Notes the flags of a new study in the study itself, and refuses others for an old one.

    Raises:
        InputError: it names a flag that was another when the study was begun.
    """
    flags = {name: getattr(options, name) for name in ("vary", "learner", "steps", "seed")}
    for name, value in flags.items():
        told = " ".join(value) if isinstance(value, tuple) else f"{value}"
        begun = study.user_attrs.get(name)
        if begun is None:  # also in studies of former versions
            study.set_user_attr(name, told)
        elif begun != told:
            raise InputError(
                f"the study {options.study} was begun with --{name} {begun!r}, and this is "
                f"{told!r}: give the same, or name another study."
            )


def _play(options: Options, axes: list[Axis], trial: "Trial") -> float:
    """Trains once; returns the mean score of the last epoch's training games."""
    import optuna

    # By a seed of its own: else each worker and each start would draw the same settings again.
    seed = int(np.random.SeedSequence([options.seed, trial.number]).generate_state(1)[0])
    trial.study.sampler = optuna.samplers.TPESampler(seed=seed)
    folder = RunFolder(options.runs, f"{options.study}-{trial.number}")
    drawn = [part for axis in axes for part in (f"--{axis.flag}", axis.draw(trial))]
    flags = [*options.learner_flags, "--seed", f"{options.seed}", *drawn]
    trial.set_user_attr("command", join(["python", "-m", "learner", "--local", *flags]))
    place = ("--run", folder.name, "--runs", str(options.runs), "--listen", free_endpoint())
    budget = ("--steps", f"{options.steps}", "--evaluators", "0")
    log = options.runs / f"{folder.name}.log"
    told = 0
    with ExitStack() as stack:
        learner = Child("learner", "--local", *place, *budget, *flags, log=log)
        stack.callback(learner.end)
        while True:
            over = learner.poll() is not None  # asked first: its last row may come with its end
            scores = scores_of(EpochTable(folder.epochs).rows())
            for row, score in scores[told:]:
                trial.report(score, row.epoch)
            told = len(scores)
            if over:
                break
            if trial.should_prune():
                raise optuna.TrialPruned
            time.sleep(_POLL)
    if learner.returncode:
        raise learner.failure(f"training of trial {trial.number}")
    if not scores:
        raise InputError("no game ended in a whole epoch: raise --steps.")
    return scores[-1][1]


def _report(options: Options, study: "Study") -> Report:
    rows: list[Mapping[str, Any]] = [
        {
            "trial": trial.number,
            **{f"--{name}": value for name, value in trial.params.items()},
            "epochs": len(trial.intermediate_values),
            "score": trial.value if trial.state.name == "COMPLETE" else None,
            "state": trial.state.name.lower(),
        }
        for trial in study.trials
    ]
    rows.sort(key=lambda row: (row["score"] is None, -(row["score"] or 0.0)))
    if not rows:
        raise InputError(f"the study {options.study} has no trials yet: choose --trials.")
    whole = [trial for trial in study.trials if trial.state.name == "COMPLETE"]
    best = study.best_trial.user_attrs["command"] if whole else None
    about = {"study": options.study, "steps": options.steps, "vary": options.vary}
    note = f"best: {best} --steps {options.steps}" if best else "no trial is complete yet"
    return Report.of(f"study {options.study}", rows, {**about, "best": best}, note)


if __name__ == "__main__":
    main("lab.sweep", Options, measure)
