"""The Atari emulator: one game of ale-py, set as in 2017.

It knows screens, points and lives, but no episodes, states or robots. `AtariEnv` and `RobotEnv`
both play on it.
"""

from pathlib import Path

import numpy as np
from ale_py import ALEInterface, LoggerMode, roms
from numpy.typing import NDArray

from actors.envs.phosphor import glow, glow_of_fields, luminance
from common.games import check_game

_ROMS = Path(roms.__file__).parent

_EUROPEAN_ROWS = 250
"""Screen rows of games made for PAL televisions, which have other colours."""


class Emulator:
    """A game at its first frame, with colour averaging and, if ``sticky``, repeated actions.

    The picture blends the last two emulator frames, so that sprites that flicker at 30 Hz are seen.
    As a television's phosphor does, ALE gives the brighter frame 77 %, in the console's own
    colours.

    With probability ``sticky``, an emulator frame executes the action of the frame before instead
    of the one that is held (``repeat_action_probability``, Machado et al. 2018). ALE draws this
    from its own generator, which ``seed`` starts at power-on and `reset` does not restart. ALE uses
    it for nothing else: without sticky actions, the same actions always give the same game.
    """

    def __init__(self, game: str, seed: int, *, sticky: float = 0.0) -> None:
        """Raises InputError for a game that ale-py does not bundle."""
        # This holds for the whole process. It comes first because the constructor prints a banner.
        ALEInterface.setLoggerMode(LoggerMode.Error)
        self.game = check_game(game)
        self._ale = ALEInterface()
        self._ale.setInt("random_seed", seed % 2**31)
        self.sticky = sticky
        self._ale.setFloat("repeat_action_probability", sticky)
        self._ale.loadROM(_ROMS / f"{game}.bin")
        self._european = self._ale.getScreenDims()[0] == _EUROPEAN_ROWS
        self._remember()
        # Not always 0: to start some games, ALE itself presses start or fire.
        self._first_frame = self._ale.getEpisodeFrameNumber()
        self.screen_shape: tuple[int, int] = self._ale.getScreenDims()
        """Rows and columns; 210 × 160 for most games."""
        self.minimal_actions: tuple[int, ...] = tuple(
            int(action.value) for action in self._ale.getMinimalActionSet()
        )
        """Numbers of the actions that the game tells apart."""

    def reset(self) -> None:
        """Begins a new game; the console stays on."""
        self._ale.reset_game()
        self._remember()
        self._first_frame = self._ale.getEpisodeFrameNumber()

    def act(self, action: int) -> float:
        """Holds one of the 18 actions for an emulator frame; returns the points that it made.

        After game over it does nothing and returns 0.
        """
        if self._ale.game_over():
            return 0.0
        self._remember()
        return float(self._ale.act(action))

    def _remember(self) -> None:
        """Keeps the present field as the one before."""
        self._before = self._ale.getScreen()
        if self._european:
            self._before_rgb = self._ale.getScreenRGB()

    def screen_rgb(self) -> NDArray[np.uint8]:
        """Returns a new colour picture, ``uint8 [rows, columns, 3]``."""
        picture = self._ale.getScreenRGB()
        if self._european:
            return glow(picture, self._before_rgb)
        return glow_of_fields(picture, self._ale.getScreen(), self._before)

    def screen_grey(self) -> NDArray[np.uint8]:
        """Returns the picture's luminance as a new array, ``uint8 [rows, columns]``."""
        if self._european:
            return luminance(self.screen_rgb())  # as a camera sees it
        grey = self._ale.getScreenGrayscale()
        return glow_of_fields(grey, self._ale.getScreen(), self._before)

    def ram(self) -> NDArray[np.uint8]:
        """Returns the console's memory, ``uint8 [128]``."""
        return self._ale.getRAM()

    @property
    def lives(self) -> int:
        """Lives left; always 0 in a game without lives, such as Pong."""
        return int(self._ale.lives())

    @property
    def game_over(self) -> bool:
        """Whether the game has ended by its own rules."""
        return bool(self._ale.game_over())

    @property
    def frames(self) -> int:
        """Emulator frames since the game's start."""
        return int(self._ale.getEpisodeFrameNumber() - self._first_frame)
