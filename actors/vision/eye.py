"""What the robot sees of its game: the camera picture in, a frame of the state out."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Sight(NamedTuple):
    """The game as seen in one camera picture."""

    frame: NDArray[np.uint8]
    """Grey game picture, ``uint8 [84, 84]``."""
    valid: bool
    """The screen was found in this very picture."""
    corners: NDArray[np.float32] | None
    """Pixel corners of the game picture used, ``float32 [4, 2]`` (x, y), from the top left
    clockwise; None before the first screen was found."""


class Eye:
    """Finds the projector screen and unwarps the game; keeps the last good corners."""

    def __init__(self) -> None:
        self._corners: NDArray[np.float32] | None = None

    def see(self, image: NDArray[np.uint8]) -> Sight:
        """Look at a camera picture, ``uint8 [height, width, 3]`` RGB."""
        return Sight(np.zeros((84, 84), np.uint8), False, self._corners)
