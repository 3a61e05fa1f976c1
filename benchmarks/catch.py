"""Catch: a tiny visual game, which a network learns in some thousand steps.

A ball falls straight down a 7 × 7 field; the paddle at the bottom moves one cell a step. Caught
is +1, missed is -1, and either ends the game. The actions are Pong's six, of which two go right,
two go left and two stay.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import gymnasium
import numpy as np
from numpy.typing import NDArray

from actors.envs.step_info import StepInfo
from benchmarks.entry_point import add_entry_point
from common.registry import ENVIRONMENTS, Environment
from common.settings.clock import ClockConfig
from common.settings.config import RunConfig

CELLS = 7
CELL = 84 // CELLS
MOVES = (0, 0, 1, -1, 1, -1)
HISTORY = 4

RANDOM_SCORE = -0.72
"""Mean score of the random policy over 10,000 games."""


class Catch(gymnasium.Env[NDArray[np.uint8], int]):
    """The game; a state is ``uint8 [4, 84, 84]``."""

    @classmethod
    def of_run(cls, config: RunConfig, clock: ClockConfig, *, training: bool) -> "Catch":
        return cls()

    def __init__(self) -> None:
        self.observation_space = gymnasium.spaces.Box(0, 255, (HISTORY, 84, 84), np.uint8)
        self.action_space = gymnasium.spaces.Discrete(len(MOVES))  # type: ignore[assignment]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.uint8], dict[str, Any]]:
        super().reset(seed=seed)
        self._ball = int(self.np_random.integers(CELLS))
        self._paddle = int(self.np_random.integers(CELLS))
        self._height = 0
        self._frames = np.stack([self._draw()] * HISTORY)
        return self._frames.copy(), self._info(0.0)

    def step(self, action: int) -> tuple[NDArray[np.uint8], float, bool, bool, dict[str, Any]]:
        self._height += 1
        self._paddle = min(max(self._paddle + MOVES[action], 0), CELLS - 1)
        landed = self._height == CELLS - 1
        reward = (1.0 if self._ball == self._paddle else -1.0) if landed else 0.0
        self._frames = np.concatenate((self._frames[1:], self._draw()[None]))
        return self._frames.copy(), reward, landed, False, self._info(reward, landed)

    def _draw(self) -> NDArray[np.uint8]:
        frame = np.full((84, 84), 40, np.uint8)
        for row, column, grey in ((self._height, self._ball, 255), (CELLS - 1, self._paddle, 160)):
            frame[row * CELL : (row + 1) * CELL, column * CELL : (column + 1) * CELL] = grey
        return frame

    def _info(self, score: float, over: bool = False) -> dict[str, Any]:
        return StepInfo(over, score, self._height)._asdict()


CATCH = Environment("catch", "benchmarks.catch:Catch.of_run", lambda config: len(MOVES))
"""For ``--env catch``, where an installed package's metadata name it; see `install`."""


def install(folder: Path) -> None:
    """Makes `CATCH` an entry point of what is installed in ``folder``."""
    add_entry_point(folder, "catch", "environment", "catch", "benchmarks.catch:CATCH")


@contextmanager
def installed(folder: Path) -> Iterator[None]:
    """Lets this process, and those that it starts meanwhile, find Catch.

    Args:
        folder: empty; Catch is installed in it.
    """
    ENVIRONMENTS.add(CATCH)
    install(folder)
    places = str(folder), os.environ.get("PYTHONPATH")
    with patch.dict(os.environ, PYTHONPATH=os.pathsep.join(filter(None, places))):
        yield
