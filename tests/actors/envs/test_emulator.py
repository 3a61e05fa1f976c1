"""The emulator against bare ALE, and its silence."""

import subprocess
import sys

import numpy as np
import pytest
from ale_py import ALEInterface

from actors.envs.emulator import Emulator
from tests.actors.envs.narrowed import rom_of
from tests.actors.envs.sticky_reference import StickyActions


@pytest.mark.parametrize("probability", [0.25, 0.6])
def test_sticky_actions_are_those_of_ale_frame_by_frame(probability: float) -> None:
    sticky, plain = Emulator("breakout", 7, sticky=probability), Emulator("breakout", 0)
    ale = StickyActions(probability, 7)
    before, changes, repeats, games = 0, 0, 0, 1
    for held in np.random.default_rng(3).integers(18, size=6_000).tolist():
        executed = ale.frame(held)
        changes += held != before
        repeats += executed != held
        before = executed
        assert sticky.act(held) == plain.act(executed)
        assert np.array_equal(sticky.ram(), plain.ram())
        if sticky.game_over:
            for part in (sticky, plain):
                part.reset()
            ale.restart()
            before = 0
            games += 1
    assert games > 5
    assert repeats / changes == pytest.approx(probability, abs=0.03)


def test_the_screen_blends_the_last_two_frames() -> None:
    plain = ALEInterface()
    plain.setFloat("repeat_action_probability", 0.0)
    plain.setBool("color_averaging", False)
    plain.loadROM(rom_of("space_invaders"))
    emulator = Emulator("space_invaders", 1)
    before = plain.getScreenRGB().astype(float)
    each_steps = []
    for step in range(200):
        action = (0, 1, 3, 11)[step // 10 % 4]
        plain.act(action)
        emulator.act(action)
        now, seen = plain.getScreenRGB().astype(float), emulator.screen_rgb()
        bright, dark = np.maximum(before, now), np.minimum(before, now)
        differs = (bright != dark).any(axis=2)
        assert np.array_equal(seen[~differs], now[~differs])
        each_steps.append(np.abs(seen - (0.77 * bright + 0.23 * dark))[differs])
        before = now
    errors = np.concatenate(each_steps)
    assert len(errors) > 1000
    assert errors.mean() < 8  # what rounding to the console's 128 colours leaves
    assert errors.max() < 32


@pytest.mark.parametrize("game", ["pong", "air_raid", "double_dunk", "frostbite"])
def test_frames_count_from_the_games_start(game: str) -> None:
    # ALE presses start or fire itself in air_raid and double_dunk; those frames do not count.
    emulator = Emulator(game, 1)
    assert emulator.frames == 0
    emulator.act(0)
    assert emulator.frames == 1
    emulator.reset()
    assert emulator.frames == 0


def test_screens_belong_to_the_caller() -> None:
    emulator = Emulator("breakout", 1)
    kept = emulator.screen_rgb(), emulator.screen_grey(), emulator.ram()
    copies = [array.copy() for array in kept]
    for _ in range(120):
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
    emulator = Emulator("pong", 1)
    points = 0.0
    while not emulator.game_over:
        points += emulator.act(0)
    assert points == -21


def test_nothing_is_printed() -> None:
    code = (
        "from actors.envs.emulator import Emulator\n"
        "e = Emulator('breakout', 1)\n"
        "for _ in range(200): e.act(1)\n"
        "e.reset()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert (done.stdout, done.stderr) == (b"", b"")
