"""The sheet of games under drawn conditions."""

import threading
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from common.errors import InputError
from common.registry import ENVIRONMENTS
from common.settings.conditions import PERFECT_CAMERA, CameraConfig, Conditions, PlayConfig
from common.settings.presets import PRESETS
from common.settings.ranges import RandomiseConfig, all_ranges
from common.settings.stored_config import to_json
from tests.extending.test_environment import LAMPS
from tests.extending.whole_run import added
from tests.viewer.commands import parsed
from viewer.draws import Draws, sheet, told


def test_all_ranges_are_drawn_but_for_what_is_given() -> None:
    found = parsed(Draws, "--randomise.noise", 0, "--count", 3)
    assert found.count == 3
    assert found.randomise.noise == 0
    assert found.randomise.gamma == all_ranges("robot").gamma


def test_one_range_may_be_given_without_a_robot_which_has_others(tmp_path: Path) -> None:
    flags = ("--env", "ale", "--randomise.gamma", 1.2, "-o", tmp_path / "d.png")
    command = parsed(Draws, *flags)
    command.check()
    assert command.randomise == replace(all_ranges("ale"), gamma=1.2)


def test_the_ranges_of_a_run_are_drawn(tmp_path: Path) -> None:
    file = tmp_path / "config.json"
    file.write_text(
        to_json(replace(PRESETS["robot"], randomise=RandomiseConfig(actuation_latency=3)))
    )
    command = parsed(Draws, "--config", file, "--randomise.noise", 2)
    assert command.config().randomise == RandomiseConfig(actuation_latency=3, noise=2.0)


@pytest.mark.parametrize(("env", "tall"), [("robot", 436), ("ale", 436)])
def test_the_first_game_is_the_usual_one_and_the_others_differ(
    env: str, tall: int, tmp_path: Path
) -> None:
    file = tmp_path / "made" / "draws.png"
    parsed(Draws, "--env", env, "--count", 3, "-o", file).run(threading.Event())
    page = cv2.imread(str(file))
    assert page is not None
    assert page.shape == (tall, 3 * 480, 3)
    tiles = np.hsplit(page, 3)
    assert all(tile.std() > 10 for tile in tiles)
    assert not np.array_equal(tiles[1], tiles[2])


def test_what_cannot_be_drawn_or_written_is_refused_before_the_games(tmp_path: Path) -> None:
    flags = ("--env", "ale", "--randomise.head-pose", 3, "-o", tmp_path / "d.png")
    turned = parsed(Draws, *flags)
    with pytest.raises(InputError, match=r"^--randomise.head-pose is 3.0, which means nothing"):
        turned.check()
    with pytest.raises(InputError, match=r"d\.txt does not name a picture"):
        parsed(Draws, "-o", tmp_path / "d.txt").check()


def test_an_environment_from_outside_is_drawn_without_conditions(tmp_path: Path) -> None:
    file = tmp_path / "d.png"
    with added(ENVIRONMENTS, LAMPS):
        parsed(Draws, "--env", "lamps", "--count", 3, "-o", file).run(threading.Event())
    page = cv2.imread(str(file))
    assert page is not None
    assert page.shape == (368, 3 * 480, 3)
    for tile in np.hsplit(page, 3):  # the network's frame, in which one of three lamps is lit
        assert sorted(tile[180, 120 + 120 * lamp].max() for lamp in range(3)) == [0, 0, 255]


def test_a_stop_ends_it_early(tmp_path: Path) -> None:
    stop = threading.Event()
    stop.set()
    file = tmp_path / "draws.png"
    with pytest.raises(InputError, match="stopped before any game"):
        Draws(env="ale", output=file).run(stop)
    assert not file.exists()


def test_every_setting_that_is_drawn_is_told() -> None:
    usual = told(Conditions(PlayConfig(), PERFECT_CAMERA))
    play = PlayConfig(
        actuation_latency=3, actuation_jitter=2, arm_speed=0.7, key_threshold=1.2, sticky=0.25
    )
    camera = CameraConfig(
        latency=1, dropped=0.1, noise=4.0, blur=0.5, gamma=1.3, brightness=0.8, red=1.1,
        green=0.9, blue=1.2, ambient=0.1, glare=0.3, distortion=0.05, yaw=3.0, pitch=-2.0,
        screen_distance=1.1, screen_tilt=4.0,
    )  # fmt: skip
    found = told(Conditions(play, camera))
    words = [[line.replace(",", "").split() for line in lines] for lines in (usual, found)]
    changed = [
        now
        for before, after in zip(*words, strict=True)
        for was, now in zip(before, after, strict=True)
        if was != now
    ]
    assert len(changed) == 5 + 16


def test_tiles_fill_rows_of_four() -> None:
    tiles = [np.full((2, 3, 3), number, np.uint8) for number in range(6)]
    page = sheet(tiles)
    assert page.shape == (4, 12, 3)
    assert page[0, ::3, 0].tolist() == [0, 1, 2, 3]
    assert page[2, ::3, 0].tolist() == [4, 5, 0, 0]
