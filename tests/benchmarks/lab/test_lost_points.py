"""`python -m benchmarks.lab.lost_points`: rallies counted by hand, and real games of Pong."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from actors.envs.step_info import StepInfo
from actors.loop import Step
from benchmarks import report
from benchmarks.lab import lost_points
from benchmarks.lab.lost_points import Point, points_of, rows_of
from common.errors import InputError

_STATE = np.zeros((4, 84, 84), np.uint8)
_INFO = StepInfo(False, 0, 0)


def rewards(*games: Sequence[float]) -> Iterator[Step]:
    """Yields a step for each reward; the last one of a game ends it."""
    for game in games:
        for time, r_t in enumerate(game):
            last = time == len(game) - 1
            yield Step(0, time == 0, _STATE, True, 0, False, r_t, last, False, _STATE, _INFO)


def test_a_point_knows_the_one_before_it_and_how_long_ago_that_was() -> None:
    found = list(points_of(rewards([0, 0, -1, 1, 0, -1], [0, 1])))
    assert found == [Point(0, 3, False), Point(-1, 1, True), Point(1, 2, False), Point(0, 2, True)]


def test_a_game_without_a_point_at_its_end_tells_nothing_to_the_next_one() -> None:
    assert list(points_of(rewards([1, 0, 0], [0, -1]))) == [Point(0, 1, True), Point(0, 2, False)]


def test_rows_tell_which_share_of_the_rallies_that_came_so_far_was_lost_there() -> None:
    rallies = [(29, False), (30, True), (30, False), (59, False), (95, True)]
    rows = rows_of([Point(1, *rally) for rally in rallies] + [Point(-1, 5, True)], 30)
    assert [tuple(row.values()) for row in rows] == [
        ("a point lost", "0 to 29", 1, 0, 0.0),
        ("a point won", "0 to 29", 0, 1, 1 / 5),
        ("a point won", "30 to 59", 1, 2, 2 / 4),
        ("a point won", "90 to 119", 1, 0, 0.0),
    ]


def test_a_network_that_plays_at_random_loses_its_points_soon(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results = tmp_path / "points.json"
    flags = ["ale_pong", "--games", "1", "--epsilon", "1", "--sticky", "0.25"]
    report.run(
        "lab.lost_points",
        lost_points.Options,
        lost_points.measure,
        [*flags, "--json", str(results)],
    )
    found = json.loads(results.read_text())
    assert found["lost"] == 21
    assert found["won"] < 5
    assert sum(row["lost"] for row in found["rows"]) == 21
    assert (found["epsilon"], found["sticky"], found["games"]) == (1.0, 0.25, 1)
    assert "21 lost" in capsys.readouterr().out


def test_a_share_above_one_is_refused() -> None:
    with pytest.raises((InputError, SystemExit)):
        report.run(
            "lab.lost_points",
            lost_points.Options,
            lost_points.measure,
            ["ale_pong", "--sticky", "1.5"],
        )
