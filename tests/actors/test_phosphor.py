"""The blend of two fields against ALE's own colour averaging."""

import numpy as np
import pytest
from ale_py import ALEInterface, roms

from actors.envs.emulator import GAMES, Emulator

# Its picture stands still while the console thinks, and what ALE then blends is not to be seen.
_THINKING = {"tic_tac_toe_3d"}


def assert_same_as_ale(game: str, frames: int) -> bool:
    """Whether there was anything to blend."""
    ale = ALEInterface()
    ale.setFloat("repeat_action_probability", 0.0)
    ale.setBool("color_averaging", True)
    ale.loadROM(roms.get_rom_path(game))
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


def test_a_european_game_keeps_its_own_colours() -> None:
    assert_same_as_ale("adventure", 100)


@pytest.mark.slow
@pytest.mark.parametrize("game", sorted(set(GAMES) - _THINKING))
def test_pictures_are_ales_own_in_all_games(game: str) -> None:
    assert_same_as_ale(game, 150)
