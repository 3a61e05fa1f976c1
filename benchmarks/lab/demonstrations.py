"""`python -m benchmarks.lab.demonstrations FOLDER --learner="--env ale"`: what recorded play saves.

FOLDER is a recording of a trained policy (`ale-robot record POLICY -o FOLDER --minutes 10`) or of a
person (`ale-robot human --record FOLDER`). For each seed one run begins without it and one with it,
under the same settings. The table gives the agent steps that the run's own actors had played when
an epoch's test first reached the score; recorded steps do not count. The same command resumes an
interrupted training.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from benchmarks.lab.policy import (
    TrainingOptions,
    first_at,
    noted,
    scores_of,
    summary_of_all,
    train,
)
from benchmarks.report import Report, main
from common.atomic_file import write_json
from common.checked import FromOne
from common.run.epochs import EpochTable
from common.run.folder import RunFolder

_WITHOUT, _WITH = _BOTH = ("without", "with")


@dataclass(frozen=True)
class Options(TrainingOptions):
    """Train with and without demonstrations, and compare how soon the tests reach a score."""

    recording: tyro.conf.Positional[Path]
    """Folder of the recording."""
    score: float = 18.0
    """Mean score of a test that a run is to reach."""
    steps: FromOne = 500_000
    """Length of each run, in agent steps, including the warm-up and the recorded steps."""
    seeds: FromOne = 1
    """Number of pairs of runs."""
    run: str = "demonstrations"
    """First part of the runs' names."""


def measure(options: Options) -> Report:
    rows = [
        _train(options, seed, how)
        for seed in range(options.seed, options.seed + options.seeds)
        for how in _BOTH
    ]
    reached = {how: [row["own steps"] for row in rows if row["runs"] == how] for how in _BOTH}
    saved = [
        None if None in pair else pair[0] - pair[1]
        for pair in zip(reached[_WITHOUT], reached[_WITH], strict=True)
    ]
    told = [each for each in saved if each is not None]
    note = (
        "in no pair did both runs reach the score"
        if not told
        else f"saved agent steps: {', '.join(f'{each:,}' for each in told)}; "
        f"recorded: {rows[-1]['recorded']:,}"
    )
    title = f"agent steps until a test's mean score is {options.score:g}"
    summary = {"learner": options.learner, "score": options.score, "saved": saved}
    return Report.of(title, rows, summary | {"steps": options.steps}, note)


def _train(options: Options, seed: int, how: str) -> dict[str, Any]:
    folder = RunFolder(options.runs, f"{options.run}-{how}-seed-{seed}")
    given = ["--demonstrations", str(options.recording)] if how == _WITH else []
    flags = [*options.learner_flags, "--seed", f"{seed}", *given]
    asked, note = {"flags": flags, "steps": options.steps}, folder.path / "asked.json"
    if noted(note, asked, "comparison") is None:
        train(folder, options.steps, flags)
        write_json(note, asked)
    summary = summary_of_all(folder, options.steps)
    recorded = summary["demonstrations"]
    own = summary["config"]["replay"]["learning_starts"] - recorded
    tests = scores_of(EpochTable(folder.epochs).rows(), "test")
    there = first_at(tests, options.score)
    return {
        "runs": how,
        "seed": seed,
        "recorded": recorded,
        "own steps": there and there.total_train_steps + own,
        "updates": there and there.weight_updates,
        "minutes": there and there.total_time / 60,
        "best test": max((mean for _, mean in tests), default=None),
    }


if __name__ == "__main__":
    main("lab.demonstrations", Options, measure)
