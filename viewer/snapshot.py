"""All that can be shown of one agent step, gathered when it is over."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.actions import Keys


@dataclass(frozen=True)
class RobotSnapshot:
    """What only a robot has to show; pictures are ``uint8 [height, width, 3]``."""

    outside: NDArray[np.uint8]
    """The room."""
    camera: NDArray[np.uint8]
    """What the robot's camera sees, ``[240, 320, 3]``."""
    corners: NDArray[np.float32] | None
    """Corners of the game in ``camera`` as the detector has it, ``float32 [4, 2]``, clockwise."""
    found: bool
    """The corners were found in this very picture; else they are the last ones."""
    controller: NDArray[np.uint8]
    """Both hands on the keys."""


@dataclass(frozen=True)
class Snapshot:
    """One agent step, and what came of it."""

    game: str
    score: float
    step: int
    """Agent steps of the game so far."""
    screen: NDArray[np.uint8]
    """The emulator's own, ``uint8 [rows, columns, 3]``."""
    frame: NDArray[np.uint8]
    """The newest of the network's input, ``uint8 [84, 84]``."""
    wanted: Keys
    """The keys commanded."""
    pressed: Keys
    """The keys that the game was given at the agent step's end."""
    actions: tuple[int, ...]
    """ALE's numbers of the actions on offer."""
    chosen: int
    """Index into ``actions``."""
    values: NDArray[np.float32] | None
    """Q-values that the actions were chosen by, ``float32 [actions]``; None at random play."""
    robot: RobotSnapshot | None
    """None where the emulator plays alone."""
