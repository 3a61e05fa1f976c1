"""The ladder: each rung is a configuration of the program, and a run becomes a row."""

import csv
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from benchmarks import report
from benchmarks.lab.ladder import COLUMNS, FLAGS, Options, Rung, add_row, row_of
from common.command_line.run_options import parse_run
from common.errors import InputError
from common.run.epochs import EpochPhase, EpochRow, EpochTable
from learner.figures.plot_histogram import read_evaluations
from learner.options import LearnerOptions
from tests.end_to_end.conftest import SMALL, Stage
from tests.epoch_rows import epoch_row


def differing(rung: Rung) -> dict[str, object]:
    """The settings in which a rung's run is not the plain robot's."""

    def settings_of(flags: list[str]) -> dict[str, object]:
        config = parse_run(LearnerOptions, "learner", flags, lambda _: None).config
        return {"env": config.env, **vars(config.play), "learning": config.learning}

    robot = settings_of(Options("R5").flags(1))
    found = settings_of(Options(rung).flags(1))
    return {name: value for name, value in found.items() if value != robot[name]}


def test_each_rung_is_the_robot_less_its_difficulties() -> None:
    assert differing("R1") == {"env": "ale"}
    assert differing("R2") == {"env": "ale", "press_latency": 2}
    assert differing("R3") == {"hand": "model"}
    assert differing("R4") == {"eye": "emulator"}
    assert set(FLAGS) == {"R1", "R2", "R3", "R4", "R5"}


def test_runs_have_names_of_their_own() -> None:
    names = {Options(rung).run_name(seed) for rung in FLAGS for seed in (1, 2)}
    assert len(names) == 2 * len(FLAGS)
    assert Options("R5", label="vector").run_name(1) not in names


def phase(phase: EpochPhase, epoch: int, mean: float | None) -> EpochRow:
    scores = [] if mean is None else [mean - 1, mean + 1]
    times = {"total_train_steps": 100 * epoch, "total_time": 7.5 * epoch}
    return epoch_row(scores, epoch=epoch, phase=phase, **times)


def test_a_row_tells_when_the_training_games_first_had_a_mean() -> None:
    """Tests do not count, games of an epoch without any neither, and a relapse changes nothing."""
    epochs = [
        phase("random", 0, 20.0),
        phase("train", 1, -20.0),
        phase("test", 1, 19.0),
        phase("train", 2, None),
        phase("train", 3, 0.0),
        phase("train", 4, -3.0),
        phase("train", 5, 9.3),
        phase("test", 5, 21.0),
    ]
    files: dict[str, Any] = dict.fromkeys(COLUMNS) | {"machine": {"cpu": "one", "cores": 2}}
    row = row_of(Options("R5", label="x"), 3, files, {}, epochs)
    assert tuple(row) == COLUMNS
    assert (row["rung"], row["label"], row["seed"], row["cpu"]) == ("R5", "x", 3, "one")
    assert (row["steps_to_0"], row["seconds_to_0"]) == (300, 22.5)
    assert (row["steps_to_human"], row["seconds_to_human"]) == (500, 37.5)
    assert (row["steps_to_18"], row["seconds_to_18"]) == (None, None)
    breakout = row_of(Options("R5", game="breakout"), 3, files, {}, epochs)
    assert breakout["steps_to_human"] is None  # those are Pong's


def test_a_rows_wall_clock_is_that_of_the_training() -> None:
    trained: dict[str, Any] = dict.fromkeys(COLUMNS)
    trained |= {"machine": {"cpu": "one", "cores": 2}, "wall_seconds": 7_200.0}
    row = row_of(Options("R5"), 1, trained, {"wall_seconds": 90.0, "mean": 20.5}, [])
    assert (row["wall_seconds"], row["mean"]) == (7_200.0, 20.5)


def test_rows_are_added_below_one_heading(tmp_path: Path) -> None:
    path = tmp_path / "ladder.csv"
    for seed in (1, 2):
        add_row(path, {**dict.fromkeys(COLUMNS, ""), "seed": seed, "flags": f"--seed {seed}"})
    with path.open() as file:
        assert [row["seed"] for row in csv.DictReader(file)] == ["1", "2"]


def test_a_run_that_went_on_has_its_newest_row_alone(tmp_path: Path) -> None:
    path = tmp_path / "ladder.csv"
    row = {**dict.fromkeys(COLUMNS, ""), "rung": "R2", "flags": "--seed 1, and 'more'"}
    for steps, flags in ((100, row["flags"]), (100, "--seed 2"), (200, row["flags"])):
        add_row(path, {**row, "flags": flags, "agent_steps": steps})
    with path.open() as file:
        found = [(row["flags"], row["agent_steps"]) for row in csv.DictReader(file)]
    assert found == [("--seed 2", "100"), (row["flags"], "200")]


def test_a_row_of_former_names_is_of_the_same_run(tmp_path: Path) -> None:
    path = tmp_path / "ladder.csv"
    row = {**dict.fromkeys(COLUMNS, ""), "rung": "R2"}
    for flags in ("--play.press 2", "--play.press 3", "--play.press-latency 2"):
        add_row(path, {**row, "flags": flags})
    with path.open() as file:
        found = [row["flags"] for row in csv.DictReader(file)]
    assert found == ["--play.press 3", "--play.press-latency 2"]


def test_a_table_that_cannot_be_written_is_refused_before_hours_of_training(
    tmp_path: Path,
) -> None:
    measured = Mock(side_effect=AssertionError)
    with pytest.raises(InputError, match="is a folder: name a file in it"):
        report.run("lab.ladder", Options, measured, ["--rung", "R1", "--output", str(tmp_path)])


@pytest.mark.slow
def test_a_rung_is_climbed_and_told(stage: Stage) -> None:
    output = stage.folder / "results" / "ladder.csv"
    given = ["--rung", "R3", "--steps", "650", "--games", "2", "--output", str(output)]
    learner = f"--learner=--threads 1 {' '.join(SMALL)}"
    stage.start("-m", "benchmarks.lab.ladder", *given, learner).ends()
    name = Options("R3").run_name(1)
    with output.open() as file:
        (row,) = csv.DictReader(file)
    assert (row["rung"], row["games"], row["epsilon"]) == ("R3", "2", "0.001")
    assert int(row["agent_steps"]) >= 650
    assert -21 <= float(row["mean"]) <= 21
    # Keys as commanded, screen seen by the camera.
    assert (float(row["press_match_share"]), float(row["valid_frame_share"])) == (1.0, 1.0)
    assert "--play.hand model" in row["flags"]
    (found,) = read_evaluations(output.parent / f"{name}.json")
    assert found.mean == float(row["mean"])
    trained = [
        each for each in EpochTable(output.parent / f"{name}.csv").rows() if each.phase == "train"
    ]
    assert len(trained) >= 2
