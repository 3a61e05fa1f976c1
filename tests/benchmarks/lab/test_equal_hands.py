"""`python -m benchmarks.lab.equal_hands` on hands of which each frame is known."""

import json
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import report
from benchmarks.lab import equal_hands
from benchmarks.lab.equal_hands import keys_held, random_commands
from common.actions import Keys
from common.errors import InputError
from common.registry import ROBOTS, RobotKind
from common.settings.conditions import MAX_ADDED
from tests.actors.robots.latency_model.models import delay, saved
from tests.extending.whole_run import added

LEFT, RIGHT = int(Keys.LEFT), int(Keys.RIGHT)


class LateRobot:
    """A robot whose hands need three frames, and never press ``broken``."""

    broken = Keys.NONE

    def __init__(self, *made_with: Any) -> None:
        for play in made_with[2:]:
            assert play.robot == type(self).__name__
        self.rest()

    def rest(self) -> None:
        self._wanted = [Keys.NONE] * 3
        self.command(Keys.NONE)

    def command(self, keys: Keys) -> None:
        self._last = keys & ~self.broken

    @property
    def held(self) -> Keys:
        return self._wanted[0]

    def step_frame(self) -> Keys:
        self._wanted = [*self._wanted[1:], self._last]
        return self.held

    def close(self) -> None:
        pass


class WithoutFire(LateRobot):
    broken = Keys.FIRE


class Unmeasured(LateRobot):
    def step_frame(self) -> Keys:
        raise AssertionError("it is measured")


def run(tmp_path: Path, *flags: str) -> list[dict[str, float]]:
    with ExitStack() as registered:
        for kind in (LateRobot, WithoutFire, Unmeasured):
            registered.enter_context(added(ROBOTS, RobotKind(kind.__name__, kind, joints=0)))
        report.run(
            "lab.equal_hands",
            equal_hands.Options,
            equal_hands.measure,
            ["--json", f"{tmp_path / 'found.json'}", "--steps", "300", *flags],
        )
    rows: list[dict[str, float]] = json.loads((tmp_path / "found.json").read_text())["rows"]
    return rows


def test_keys_are_held_one_latency_later_with_a_gap_between_two() -> None:
    found = keys_held(LateRobot(), [Keys.NONE, Keys.LEFT, Keys.LEFT, Keys.RIGHT, Keys.NONE], 4)
    # Four frames of latency. A hand at rest presses one frame after that, and one that comes from
    # another key two frames after it.
    assert found.tolist() == [0] * 8 + [0, *[LEFT] * 7] + [0, 0, *[RIGHT] * 2]


def test_commands_are_drawn_once_in_so_many_agent_steps() -> None:
    keys = [Keys.NONE, Keys.LEFT, Keys.RIGHT]
    commands = random_commands(keys, 4, 9_000, seed=1)
    changes = sum(one != other for one, other in pairwise(commands))
    assert changes == pytest.approx(9_000 / 4 * 2 / 3, rel=0.1)  # a third of them draw the same
    assert len(commands) == 9_000
    assert {*commands} == {*keys}
    assert random_commands(keys, 1, 50, seed=1) != random_commands(keys, 1, 50, seed=2)


def test_hands_that_can_keep_the_schedule_keep_it_in_every_frame(tmp_path: Path) -> None:
    rows = run(tmp_path, "--robots", "LateRobot", "--latency", "5")
    assert [row["share of frames with other keys"] for row in rows] == [0, 0, 0]
    assert [row["agent steps between commands"] for row in rows] == [1, 3, 12]
    told = json.loads((tmp_path / "found.json").read_text())
    asked = {"latency": 5, "game": "pong", "steps": 300, "seed": 1}
    assert {name: told.get(name) for name in asked} == asked


def test_commands_may_be_planned_by_a_model_of_the_hands(tmp_path: Path) -> None:
    late, wrong = (saved(tmp_path / f"{frames}.npz", delay(frames)) for frames in (2, 0))
    flags = ("--robots", "LateRobot", "--latency", "5", "--gap", "4", "--every", "3")
    assert run(tmp_path, *flags, "--hands-model", late)[0]["share of frames with other keys"] == 0
    # What the model does not need counts as the way of the commands.
    assert run(tmp_path, *flags, "--hands-model", wrong)[0]["share of frames with other keys"] == 0


def test_hands_that_need_longer_differ_and_most_where_commands_are_short(tmp_path: Path) -> None:
    rows = run(tmp_path, "--robots", "LateRobot", "--latency", "1")
    short, longer, longest = (row["share of frames with other keys"] for row in rows)
    assert short > longer > longest > 0


@pytest.mark.parametrize(
    ("game", "seed", "more"),
    [("pong", 1, [Keys.RIGHT | Keys.FIRE, Keys.LEFT | Keys.FIRE]), ("breakout", 2, [])],
)
def test_a_broken_key_costs_the_frames_in_which_it_is_to_be_held(
    game: str, seed: int, more: list[Keys], tmp_path: Path
) -> None:
    flags = ("--latency", "5", "--every", "3", "--game", game, "--seed", f"{seed}")
    rows = run(tmp_path, "--robots", "WithoutFire", *flags)
    own = [Keys.NONE, Keys.FIRE, Keys.RIGHT, Keys.LEFT, *more]
    commands = random_commands(own, 3, 300, seed)
    fire = keys_held(LateRobot(), commands, 5) & int(Keys.FIRE) > 0
    assert rows[0]["share of frames with other keys"] == pytest.approx(np.mean(fire))
    assert 0.1 < np.mean(fire) < 0.6


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--game", "pung"], "no game 'pung'"),
        (["--latency", "0"], "--latency is 0"),
        (["--latency", f"{MAX_ADDED + 1}"], f"--latency is {MAX_ADDED + 1}"),
        (["--every", "3", "0"], r"--every.* is 0"),
        (["--robots", "Unmeasured", "nobody"], "there is no robot 'nobody'"),
        (["--robots", "Unmeasured", "none.npz"], r"none\.npz cannot be read"),
        (["--robots", "Unmeasured", "--hands-model", "none.npz"], r"none\.npz cannot be read"),
    ],
)
def test_what_cannot_be_measured_is_refused_before_anything_is(
    flags: list[str], words: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=words):
        run(tmp_path, *flags)


def test_a_file_that_cannot_be_written_is_refused_before_anything_is_measured(
    tmp_path: Path,
) -> None:
    (tmp_path / "found.json").mkdir()
    with pytest.raises(InputError, match=r"found\.json is a folder"):
        run(tmp_path, "--robots", "Unmeasured")
