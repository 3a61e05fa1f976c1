"""Layout of the projected picture: the width of the black border around the game.

The projector and the screen detector share these values.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

BORDER = 0.08
"""Black border on each side, as a share of the game picture's own width or height."""
ASPECT = 4 / 3
"""Width to height of the game picture on a television, whose 160 × 210 pixels are not square. The
border is a share of each side, so the whole projected picture has the same ratio."""

UNIT_SQUARE: NDArray[np.float32] = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
"""Corners of the projected picture in its own coordinates (x, y), clockwise from the top left."""

_FAR = 1 + BORDER
_SPAN = 1 + 2 * BORDER

GAME_IN_PICTURE: NDArray[np.float32] = (
    np.array([[BORDER, BORDER], [_FAR, BORDER], [_FAR, _FAR], [BORDER, _FAR]], np.float32) / _SPAN
)
"""Corners of the game in the projected picture, ordered as `UNIT_SQUARE`, ``float32 [4, 2]``."""


def border_of(corners: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns the corners of the whole projected picture, ``float32 [4, 2]``, from those of the
    game in it."""
    homography = cv2.getPerspectiveTransform(GAME_IN_PICTURE, corners)
    return np.asarray(cv2.perspectiveTransform(UNIT_SQUARE[None], homography)[0], np.float32)
