"""Trains and evaluates policies for the experiments, by `python -m learner` as users do.

`train` starts or resumes a run with given flags; `evaluate` and `headline` play whole games.
`summary_of_all` reads the summary of a run; `scores_of` and `first_at` search the rows of its
epochs.
"""

import json
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import tyro

from benchmarks.child import free_endpoint, run_module, scratch
from benchmarks.quoted_flags import quoted_flags
from benchmarks.report import BenchmarkOptions
from common.checked import Fraction, FromOne
from common.command_line.parser import WeightsFile
from common.command_line.run_options import parse_run
from common.errors import InputError
from common.run.epochs import EpochPhase, EpochRow
from common.run.folder import RunFolder
from learner.evaluation.options import EPSILON, GAMES
from learner.options import LearnerOptions, stored_config

_MAX_OVER = 2_000
"""Agent steps that actors may play beyond a run's end before its learner has ended, besides a tenth
of the run."""


@dataclass(frozen=True, kw_only=True)
class TrainingOptions(BenchmarkOptions):
    """The flags that every experiment with training has."""

    learner: str = ""
    """More flags for `python -m learner`, as in --learner="--play.sticky 0.25"."""
    seed: FromOne = 1
    """Seed of the first run; those of further ones follow it."""
    runs: Path = Path("runs")
    """Folder that holds the runs."""

    def check(self) -> None:
        super().check()
        _ = self.learner_flags

    @property
    def learner_flags(self) -> list[str]:
        """The words of --learner. Raises InputError if they have flags of the experiment itself."""
        own = {f"--{field.name.replace('_', '-')}" for field in fields(self)}
        return quoted_flags(self.learner, "--learner", own)


@dataclass(frozen=True, kw_only=True)
class PlayingOptions(BenchmarkOptions):
    """The flags that every experiment has in which a network plays whole games."""

    network: tyro.conf.Positional[WeightsFile]
    """Network that plays: a published policy, or a checkpoint in its run's folder."""
    games: FromOne = 10
    """Number of games of each evaluation."""
    epsilon: Fraction = EPSILON
    """Share of random actions."""


def train(folder: RunFolder, steps: int, flags: Sequence[str]) -> dict[str, Any]:
    """Trains the run in ``folder`` for ``steps`` agent steps in all; resumes it if it has begun.

    Returns:
        its ``summary.json``.

    Raises:
        InputError: the run failed and printed why, was stopped early, or was trained for longer.
    """
    if folder.summary.exists():
        trained = int(json.loads(folder.summary.read_bytes())["agent_steps"])
        if trained > 1.1 * steps + _MAX_OVER:
            raise InputError(
                f"{folder.path} has {trained:,} agent steps instead of {steps:,}, as a run of "
                "another experiment: name another folder with --runs."
            )
        if trained >= steps:
            return summary_of_all(folder, steps)
    resumed = ["--resume"] if folder.config_file.exists() else []
    place = ["--run", folder.name, "--runs", str(folder.path.parent)]
    address = ["--listen", free_endpoint()]
    asked = ["--local", *place, "--steps", f"{steps}", *resumed, *address, *flags]
    _check_training(asked)
    # A run is a part of the experiment, which alone goes on with it.
    again = shlex.join(["python", *sys.orig_argv[1:]])
    run_module("learner", *asked, env={"ALE_ROBOT_EXPERIMENT": again})
    return summary_of_all(folder, steps)


def _check_training(flags: Sequence[str]) -> None:
    """Raises InputError if `python -m learner` would refuse ``flags``."""
    try:
        options = parse_run(LearnerOptions, "learner", flags, stored_config)
        options.check()
        options.check_here()
    except InputError as error:
        raise InputError(f"python -m learner refuses to train: {error}") from None


def noted(note: Path, asked: dict[str, Any], experiment: str) -> dict[str, Any] | None:
    """Returns what a training left in ``note`` when it was done; None if there is no such file yet.

    Args:
        asked: what was asked of the training, which is part of its note.
        experiment: its name, for people.

    Raises:
        InputError: the note is damaged, or of another training.
    """
    if not note.exists():
        return None
    try:
        known: dict[str, Any] = json.loads(note.read_bytes())
        same = known == known | asked
    except (ValueError, TypeError):
        same = False
    if not same:
        raise InputError(f"{note} is damaged or of another {experiment}: name another with --run.")
    return known


def summary_of_all(folder: RunFolder, steps: int) -> dict[str, Any]:
    """Returns the ``summary.json`` of a run that was to have ``steps`` agent steps.

    Raises:
        InputError: the run was stopped early.
    """
    summary: dict[str, Any] = json.loads(folder.summary.read_text())
    if summary["agent_steps"] < steps:
        raise InputError(
            f"{folder.name} was stopped after {summary['agent_steps']:,} of {steps:,} "
            "agent steps: give the same command again to resume it."
        )
    return summary


def scores_of(
    rows: Sequence[EpochRow], phase: EpochPhase = "train"
) -> list[tuple[EpochRow, float]]:
    """Returns the epochs in whose ``phase`` a game ended, each with the mean score."""
    return [
        (row, row.average_reward)
        for row in rows
        if row.phase == phase and row.average_reward is not None
    ]


def first_at(scores: Sequence[tuple[EpochRow, float]], least: float) -> EpochRow | None:
    """Returns the first epoch with a mean score of at ``least`` that; None if there is none."""
    return next((row for row, mean in scores if mean >= least), None)


def evaluate(
    network: Path,
    games: int,
    epsilon: float | None = None,
    flags: Sequence[str] = (),
    *,
    quiet: bool = False,
) -> dict[str, Any]:
    """Returns the JSON of an evaluation; its table goes to the terminal unless ``quiet``.

    Args:
        epsilon: share of random actions; None for that of the program, or of ``--headline``.
        flags: settings that differ from those of the network's training.

    Raises:
        InputError: there is no ``network``, or the evaluation failed and printed why.
    """
    if not network.exists():
        raise InputError(
            f"{network} does not exist: name --runs, and --label if there was one, as when it was "
            "trained."
        )
    with scratch() as folder:
        found = folder / "evaluation.json"
        asked = ["--games", f"{games}", "--json", str(found)]
        if epsilon is not None:
            asked += ["--epsilon", f"{epsilon}"]
        run_module("learner.evaluation", str(network), *asked, *flags, quiet=quiet)
        content: dict[str, Any] = json.loads(found.read_bytes())
        return content


def headline(network: Path) -> list[dict[str, Any]]:
    """Returns the three evaluations of --headline, with as many games as usual; raises InputError
    as `evaluate` does."""
    flags = ["--headline"]
    found: list[dict[str, Any]] = evaluate(network, GAMES, None, flags, quiet=True)["rows"]
    return found
