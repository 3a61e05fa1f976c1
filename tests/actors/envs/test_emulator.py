"""The emulator against bare ALE, and its silence."""

import subprocess
import sys

import numpy as np
import pytest
from ale_py import ALEInterface, roms

from actors.envs.emulator import Emulator


@pytest.mark.parametrize("game", ["pong", "breakout", "ms_pacman", "journey_escape"])
def test_four_single_frames_are_one_skip_of_four(game: str) -> None:
    single, skipping = Emulator(game, 1), Emulator(game, 1, frame_skip=4)
    rng = np.random.default_rng(0)
    games = 1
    for action in rng.integers(18, size=300).tolist():
        points = sum(single.act(action) for _ in range(4))
        assert skipping.act(action) == points
        assert np.array_equal(single.screen_rgb(), skipping.screen_rgb())
        assert np.array_equal(single.screen_grey(), skipping.screen_grey())
        assert np.array_equal(single.ram(), skipping.ram())
        assert (single.lives, single.game_over) == (skipping.lives, skipping.game_over)
        if single.game_over:
            single.reset()
            skipping.reset()
            games += 1
    assert game != "breakout" or games > 1


def test_the_screen_blends_the_last_two_frames() -> None:
    plain = ALEInterface()
    plain.setFloat("repeat_action_probability", 0.0)
    plain.setBool("color_averaging", False)
    plain.loadROM(roms.get_rom_path("space_invaders"))
    emulator = Emulator("space_invaders", 1)
    before = plain.getScreenRGB().astype(float)
    errors = []
    for step in range(200):
        action = (0, 1, 3, 11)[step // 10 % 4]
        plain.act(action)
        emulator.act(action)
        now, seen = plain.getScreenRGB().astype(float), emulator.screen_rgb()
        bright, dark = np.maximum(before, now), np.minimum(before, now)
        differs = (bright != dark).any(axis=2)
        assert np.array_equal(seen[~differs], now[~differs])
        errors.append(np.abs(seen - (0.77 * bright + 0.23 * dark))[differs])
        before = now
    errors = np.concatenate(errors)
    assert len(errors) > 1000
    assert errors.mean() < 8  # what rounding to the console's 128 colours leaves
    assert errors.max() < 32


@pytest.mark.parametrize("game", ["pong", "air_raid", "double_dunk", "frostbite"])
def test_frames_count_from_the_games_start(game: str) -> None:
    # ALE presses start or fire itself in air_raid and double_dunk; those frames do not count.
    emulator = Emulator(game, 1, frame_skip=4)
    assert emulator.frames == 0
    emulator.act(0)
    assert emulator.frames == 4
    emulator.reset()
    assert emulator.frames == 0


def test_screens_belong_to_the_caller() -> None:
    emulator = Emulator("breakout", 1, frame_skip=4)
    kept = emulator.screen_rgb(), emulator.screen_grey(), emulator.ram()
    copies = [array.copy() for array in kept]
    for _ in range(30):
        emulator.act(1)
    assert all(np.array_equal(*pair) for pair in zip(kept, copies, strict=True))
    assert not np.array_equal(emulator.screen_rgb(), kept[0])


def test_screen_shapes_follow_the_game() -> None:
    for game, rows in (("pong", 210), ("journey_escape", 230)):
        emulator = Emulator(game, 1)
        assert emulator.screen_shape == (rows, 160)
        assert emulator.screen_rgb().shape == (rows, 160, 3)
        assert emulator.screen_grey().shape == (rows, 160)


def test_minimal_actions_and_lives() -> None:
    pong, breakout = Emulator("pong", 1), Emulator("breakout", 1)
    assert pong.minimal_actions == (0, 1, 3, 4, 11, 12)
    assert breakout.minimal_actions == (0, 1, 3, 4)
    assert (pong.lives, breakout.lives) == (0, 5)


def test_pong_lost_without_moving_scores_minus_21() -> None:
    emulator = Emulator("pong", 1, frame_skip=4)
    points = 0.0
    while not emulator.game_over:
        points += emulator.act(0)
    assert points == -21


def test_nothing_is_printed() -> None:
    code = (
        "from actors.envs.emulator import Emulator\n"
        "e = Emulator('breakout', 1, frame_skip=4)\n"
        "for _ in range(50): e.act(1)\n"
        "e.reset()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert (done.stdout, done.stderr) == (b"", b"")
