"""The sight benchmark: its goals on small samples, and its yardsticks against known truth."""

import json
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from actors.robots.nao.robot import Nao
from benchmarks.lab import sight
from benchmarks.lab.sight_poses import (
    FAULTS,
    PERFECT,
    Case,
    FaultyCamera,
    Look,
    Tally,
    cases,
    corners_in,
    measure,
)
from benchmarks.lab.sight_probe import collect, probe
from benchmarks.report import run
from common.settings.conditions import CameraConfig

GAMES = ("pong", "space_invaders", "asteroids")


def changed(eye: FaultyCamera) -> set[str]:
    """Names of what is not as in a perfect eye."""
    return {
        name
        for part in ("camera", "changes")
        for name, value in vars(getattr(eye, part)).items()
        if value != getattr(getattr(PERFECT, part), name)
    }


def test_cases_hold_every_fault_alone_and_all_together() -> None:
    found = cases()
    assert found[0].eye == PERFECT
    assert sum(case.eye == FAULTS for case in found) == 3
    alone = [changed(case.eye) for case in found if case.eye not in (PERFECT, FAULTS)]
    assert all(len(names) == 1 for names in alone)
    assert set().union(*alone) == changed(FAULTS)
    assert len(alone) == len(changed(FAULTS)) == 9


@pytest.mark.parametrize(
    "case", [Case("perfect"), Case("all faults", FAULTS)], ids=lambda case: case.name
)
def test_corners_and_frames_from_random_poses(case: Case) -> None:
    looks: list[Look] = []
    tallies = measure(case, GAMES, 5, np.random.default_rng(3), looks.append)
    together = tallies["pong"] + tallies["space_invaders"] + tallies["asteroids"]
    figures = together.figures()
    assert figures["pictures"] == len(looks) == 15
    assert figures["found"] == 1.0
    assert figures["p50_px"] <= figures["p95_px"] <= figures["max_px"] <= sight.MAX_PIXELS
    if case.eye == PERFECT:
        assert tallies["pong"].figures()["difference"] <= sight.MAX_DIFFERENCE


@pytest.mark.parametrize(
    ("eye", "poses", "least"), [(PERFECT, 3, 1.0), (FAULTS, 12, 0.9)], ids=["perfect", "all faults"]
)
def test_a_screen_behind_an_arm_is_where_it_was(
    eye: FaultyCamera, poses: int, least: float
) -> None:
    case = Case("an arm rises", eye, "later")
    tallies = measure(case, ("pong", "breakout"), poses, np.random.default_rng(4))
    figures = sum(tallies.values(), Tally()).figures()
    assert figures["found"] >= least
    assert figures["p95_px"] <= sight.MAX_PIXELS


def test_corners_of_the_room_are_where_a_white_game_ends() -> None:
    """The truth itself, against the outline of the light that is really projected."""
    room = Nao()
    room.set_eye(CameraConfig(yaw=5.0, pitch=-4.0, screen_distance=1.1, screen_tilt=4.0))
    dark, light = (
        room.picture(np.full((210, 160, 3), level, np.uint8))[:, :, 0].astype(float)
        for level in (0, 255)
    )
    lit = (light - dark) / 255
    # A polygon's area and middle (the shoelace formula), against those of the light.
    x, y = corners_in(room).T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    area = cross.sum() / 2
    rows, columns = np.mgrid[: lit.shape[0], : lit.shape[1]]
    assert lit.sum() == pytest.approx(area, rel=0.01)
    assert (lit * columns).sum() / lit.sum() == pytest.approx(
        ((x + np.roll(x, -1)) * cross).sum() / (6 * area), abs=0.1
    )
    assert (lit * rows).sum() / lit.sum() == pytest.approx(
        ((y + np.roll(y, -1)) * cross).sum() / (6 * area), abs=0.1
    )
    room.close()


def dots(count: int) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """Frames with one bright block somewhere, and where."""
    rng = np.random.default_rng(0)
    frames = np.full((count, 84, 84), 90, np.uint8)
    places = rng.integers(20, 40, (count, 2))
    for frame, (x, y) in zip(frames, places, strict=True):
        frame[y : y + 3, x : x + 3] = 200
    return frames, places.astype(float)


def test_the_probe_reads_off_what_is_there_and_nothing_else() -> None:
    frames, places = dots(600)
    assert (probe(frames, places) > 0.98).all()
    assert (probe(frames, np.random.default_rng(1).permutation(places)) < 0.1).all()


def test_paddles_and_ball_can_be_read_off_few_frames() -> None:
    # A game in which much repeats itself: of other games than the first more would be needed.
    frames = collect(1200, PERFECT, 1)
    assert len(frames.seen) > 600
    for found in (probe(frames.own, frames.truth), probe(frames.seen, frames.truth)):
        assert (found >= 0.97).all()
    without = frames.own.copy()
    without[:, :, 12:72] = 87  # no ball
    assert probe(without, frames.truth)[2] < 0.8


@pytest.mark.slow
def test_paddles_and_ball_can_be_read_off() -> None:
    frames = collect(7000, PERFECT, 1)
    assert (probe(frames.seen, frames.truth) >= sight.LEAST_EXPLAINED).all()


def test_the_command_writes_results_and_a_picture(tmp_path: Path) -> None:
    results, picture = tmp_path / "sight.json", tmp_path / "made" / "sight.png"
    words = ["--games", "pong", "--poses", "1", "--frames", "400"]
    words += ["--json", str(results), "-o", str(picture)]
    few = [Case("perfect"), Case("all faults", FAULTS)]
    with patch.object(sight, "cases", lambda: few):
        run("lab.sight", sight.Options, sight.measure_sight, words)
    content = json.loads(results.read_text())
    assert set(content["corners"]) == {case.name for case in few}
    assert content["corners"]["perfect"]["pictures"] == 1
    assert content["probe"][0]["frames from"] == "the emulator itself"
    assert set(content["goals"]) == {"corners", "difference", "probe"}
    assert "machine" in content
    page = cv2.imread(str(picture))
    assert page is not None
    assert page.shape == (360, 4 * 480, 3)
    assert page.std() > 20
