"""`python -m benchmarks.lab.ladder --rung R3`: from the emulator to the robot, rung by rung.

Each rung is a configuration of the program and adds one difficulty to another rung, so that a rung
that is missed shows what holds learning back. An ablation is a rung with other settings and a name
of its own: `--rung R5 --label vector --learner="--play.vector"`.

R1  the emulator alone
R2  the emulator under keys as late as the robot's: none at all for two frames, then the new ones
R3  the camera's pixels, keys as commanded: no hand
R4  the emulator's pixels, keys pressed by the arms: no camera
R5  the robot
"""

import csv
import io
import shlex
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from benchmarks.lab.games import ANCHORS
from benchmarks.lab.policy import TrainingOptions, evaluate, first_at, scores_of, train
from benchmarks.report import Report, main, scored, with_time_left
from common.atomic_file import check_new_file, write_atomically, write_json
from common.checked import Fraction, FromOne
from common.command_line.parser import PRESENT_FLAGS
from common.run.epochs import EpochRow, EpochTable
from common.run.folder import RunFolder
from learner.evaluation.options import EPSILON, GAMES

Rung = Literal["R1", "R2", "R3", "R4", "R5"]

PRESS = 2
"""Frames that the game plays without a new command's keys. The robot's median latency, 50 ms by
`python -m benchmarks.lab.press_latency`, presses them in the third frame. The old command's keys
are released at once."""
FLAGS: dict[Rung, list[str]] = {
    "R1": ["--env", "ale"],
    "R2": ["--env", "ale", "--play.press-latency", f"{PRESS}"],
    "R3": ["--env", "robot", "--play.hand", "model"],
    "R4": ["--env", "robot", "--play.eye", "emulator"],
    "R5": ["--env", "robot"],
}
MILESTONES = {"0": 0.0, "human": ANCHORS["pong"].human, "18": 18.0}
"""Scores in Pong for which the table has the first time, by their names in the columns."""
COLUMNS = (
    "rung", "label", "game", "seed", "flags", "agent_steps", "updates", "wall_seconds",
    "random_reward", "best_test_reward",
    *(f"{what}_to_{name}" for name in MILESTONES for what in ("steps", "seconds")),
    "games", "epsilon", "mean", "deviation", "iqm", "iqm_low", "iqm_high",
    "press_match_share", "valid_frame_share", "cpu", "cores", "device", "git_commit", "git_dirty",
    "note",
)  # fmt: skip
"""Columns of the table. ``steps_to_0`` and the like: training steps, without those of the warm-up,
and wall-clock seconds at the end of the first epoch whose training games had that mean; empty if
there was none. ``flags`` use the names of the row's commit. ``note``, written by hand: why the
flags do not reproduce the row there.
"""


@dataclass(frozen=True)
class Options(TrainingOptions):
    """Train one rung of the ladder and evaluate it; each seed adds a row of results."""

    rung: Rung
    steps: FromOne = 1_000_000
    """Length of each run, in agent steps; the same command resumes a run that was stopped."""
    seeds: FromOne = 1
    """Number of runs, each with a seed of its own."""
    game: str = "pong"
    """Game: any that ale-py bundles, in snake_case."""
    preset: Literal["fast", "robot"] = "robot"
    """Preset of the run; compare only rungs with the same preset."""
    label: str = ""
    """Name of an ablation, where --learner changes settings of the rung."""
    games: FromOne = GAMES
    """Number of games of each evaluation."""
    epsilon: Fraction = EPSILON
    """Share of random actions in each evaluation."""
    output: Path = Path("benchmarks/results/ladder.csv")
    """Table to which the rows are added; each run's epochs and a JSON of its games go beside it."""

    def check(self) -> None:
        super().check()
        check_new_file(self.output)

    def flags(self, seed: int) -> list[str]:
        """Returns the flags of the learner, without its folder."""
        run = ["--preset", self.preset, "--game", self.game, "--seed", f"{seed}"]
        return [*run, *FLAGS[self.rung], *self.learner_flags]

    def run_name(self, seed: int) -> str:
        parts = ("ladder", self.rung, self.label, self.game, self.preset, f"seed-{seed}")
        return "-".join(filter(None, parts)).replace("_", "-")


def climb(options: Options, seed: int) -> dict[str, Any]:
    """Trains and evaluates one run; returns its row."""
    folder = RunFolder(options.runs, options.run_name(seed))
    summary = train(folder, options.steps, options.flags(seed))
    results = options.output.parent
    evaluation = results / f"{folder.name}.json"
    told = evaluate(folder.checkpoint, options.games, options.epsilon)
    write_json(evaluation, told)
    shutil.copyfile(folder.epochs, results / f"{folder.name}.csv")
    return row_of(options, seed, summary, told, EpochTable(folder.epochs).rows())


def row_of(
    options: Options,
    seed: int,
    summary: dict[str, Any],
    evaluation: dict[str, Any],
    epochs: Sequence[EpochRow],
) -> dict[str, Any]:
    """Returns a row with `COLUMNS`, from the run's files."""
    found = {
        **summary,
        **evaluation,
        **_milestones(epochs if options.game == "pong" else []),
        "rung": options.rung,
        "label": options.label,
        "game": options.game,
        "seed": seed,
        "flags": shlex.join(options.flags(seed)),
        "wall_seconds": summary["wall_seconds"],  # of the training, not of the games
        "cpu": summary["machine"]["cpu"],
        "cores": summary["machine"]["cores"],
        "note": "",
    }
    return {name: found[name] for name in COLUMNS}


def _milestones(epochs: Sequence[EpochRow]) -> dict[str, float | None]:
    scores = scores_of(epochs)
    found: dict[str, float | None] = {}
    for name, score in MILESTONES.items():
        first = first_at(scores, score)
        found[f"steps_to_{name}"] = first.total_train_steps if first else None
        found[f"seconds_to_{name}"] = first.total_time if first else None
    return found


def add_row(path: Path, row: dict[str, Any]) -> None:
    """Adds ``row`` to the table at ``path``, in place of an earlier row of the same run."""

    def identity(of: Mapping[str, Any]) -> tuple[str, ...]:
        flags = (PRESENT_FLAGS.get(each, each) for each in shlex.split(of["flags"]))
        return of["rung"], of["label"], *flags

    rows = list(csv.DictReader(path.read_text().splitlines())) if path.exists() else []
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, COLUMNS)
    writer.writeheader()
    writer.writerows(old for old in rows if identity(old) != identity(row))
    writer.writerow(row)
    write_atomically(path, text.getvalue().encode())


def measure(options: Options) -> Report:
    rows = []
    seeds = range(options.seed, options.seed + options.seeds)
    for seed in with_time_left(seeds, "seed {}".format):
        row = climb(options, seed)
        add_row(options.output, row)
        rows.append({"seed": seed, "best test": row["best_test_reward"], "games": scored(row)})
    title = f"rung {options.rung} {options.label}".strip()
    return Report.of(title, rows, {}, f"every column is in {options.output}")


if __name__ == "__main__":
    main("lab.ladder", Options, measure)
