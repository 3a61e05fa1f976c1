"""The blend of two fields against ALE's own colour averaging."""

import numpy as np
import pytest
from ale_py import ALEInterface

from actors.envs.emulator import Emulator
from common.games import GAMES
from tests.actors.envs.narrowed import rom_of

# Its picture stands still while the console thinks, and what ALE then blends is not to be seen.
_THINKING = {"tic_tac_toe_3d"}

# Made for PAL televisions, with colours of their own.
_EUROPEAN = {
    "adventure",
    "air_raid",
    "keystone_kapers",
    "king_kong",
    "klax",
    "laser_gates",
    "mr_do",
    "pacman",
    "sir_lancelot",
    "space_war",
}


def assert_same_as_ale(game: str, frames: int) -> bool:
    """Whether there was anything to blend."""
    ale = ALEInterface()
    ale.setFloat("repeat_action_probability", 0.0)
    ale.setBool("color_averaging", True)
    ale.loadROM(rom_of(game))
    emulator = Emulator(game, 1)
    blended = False
    rng = np.random.default_rng(0)
    ale.act(0)  # the field before a game's first picture is known to ALE alone
    emulator.act(0)
    for action in np.repeat(rng.integers(18, size=frames // 5), 5).tolist():
        ale.act(action)
        emulator.act(action)
        assert np.array_equal(emulator.screen_rgb(), ale.getScreenRGB())
        assert np.array_equal(emulator.screen_grey(), ale.getScreenGrayscale())
        blended |= not np.array_equal(emulator.screen_rgb(), emulator._ale.getScreenRGB())
        if emulator.game_over:
            break
    return blended


@pytest.mark.parametrize("game", ["pong", "asteroids", "qbert"])
def test_pictures_are_ales_own(game: str) -> None:
    assert assert_same_as_ale(game, 300)


@pytest.mark.parametrize("game", sorted(_EUROPEAN))
def test_a_european_game_is_blended_in_its_own_colours(game: str) -> None:
    ale = ALEInterface()
    ale.setFloat("repeat_action_probability", 0.0)
    ale.loadROM(rom_of(game))
    emulator = Emulator(game, 1)
    shown = 0
    for action in np.repeat(np.random.default_rng(0).integers(18, size=12), 5).tolist():
        before = ale.getScreenRGB().astype(int)
        ale.act(action)
        emulator.act(action)
        now, seen = ale.getScreenRGB().astype(int), emulator.screen_rgb()
        # 77 % of the way from the darker to the brighter.
        expected = np.floor(0.23 * np.minimum(now, before) + 0.77 * np.maximum(now, before))
        assert np.abs(seen - expected).max() <= 1
        # The emulator alone and the robot's camera see the same grey.
        grey = seen @ np.array([0.2989, 0.587, 0.114])
        assert np.abs(emulator.screen_grey() - grey).max() <= 0.5
        shown += seen.std() > 0
    assert shown > 30


@pytest.mark.slow
@pytest.mark.parametrize("game", sorted(set(GAMES) - _THINKING - _EUROPEAN))
def test_pictures_are_ales_own_in_all_games(game: str) -> None:
    assert_same_as_ale(game, 150)
