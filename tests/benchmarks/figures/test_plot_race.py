"""The figure of races: which lines it has."""

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.figures.plot_race import race_figure, read_races
from common.errors import InputError


def race(title: str, minutes: float, **more: Any) -> str:
    tests = [{"seconds": 60 * minutes, "mean": 3.0}, {"seconds": 120 * minutes, "mean": 9.0}]
    untested = {"seconds": 180 * minutes}
    run = {"tests": [*tests, untested]}
    settings = {
        "env": "ale",
        "game": "pong",
        "preset": None,
        "learner": "",
        "steps": 2_000,
        "every": 500,
    }
    about = {"title": title, "games": 3, "epsilon": 0.05, **settings}
    return json.dumps({**about, "runs": [run], **more})


def test_races_of_the_same_settings_are_one_series(tmp_path: Path) -> None:
    peer = {"name": "peer", "curve": [[30.0, 100, -20.0], [60.0, 200, -19.0]]}
    for name, text in (
        ("a", race("fast", 1.0)),
        ("b", race("robot", 2.0)),
        ("c", race("fast", 3.0, peer=peer)),
    ):
        (tmp_path / name).write_text(text)
    found = read_races([tmp_path / name for name in "abc"])
    tests = "pong, tests of 3 games at ε = 0.05"
    assert [(each.name, [line.tolist() for line in each.lines]) for each in found] == [
        (f"fast, {tests}", [[[1.0, 3.0], [2.0, 9.0]], [[3.0, 3.0], [6.0, 9.0]]]),
        (f"robot, {tests}", [[[2.0, 3.0], [4.0, 9.0]]]),
        ("peer, training games", [[[0.5, -20.0], [1.0, -19.0]]]),
    ]
    assert len(race_figure(found).axes[0].get_legend_handles_labels()[1]) == 3


@pytest.mark.parametrize(
    "other",
    [
        {"game": "breakout"},
        {"preset": "paper"},
        {"learner": "--envs 2"},
        {"steps": 3},
        {"every": 1},
    ],
)
def test_races_of_other_settings_are_series_of_their_own(
    other: dict[str, Any], tmp_path: Path
) -> None:
    """A label stands for their flags in the title."""
    files = [tmp_path / "a", tmp_path / "b"]
    for file, more in zip(files, ({}, other), strict=True):
        file.write_text(race("short", 1.0, **more))
    assert [len(each.lines) for each in read_races(files)] == [1, 1]


@pytest.mark.parametrize("text", ["[]", '{"runs": []}', "{"])
def test_other_files_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "a").write_text(text)
    with pytest.raises(InputError, match="race"):
        read_races([tmp_path / "a"])
