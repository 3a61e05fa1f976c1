"""The projected picture's layout: how wide the black border around the game is.

The projector draws by these numbers and the vision finds the game by them.
"""

import numpy as np
from numpy.typing import NDArray

BORDER = 0.08
"""Black border on each side, as a share of the game picture's own width or height."""
ASPECT = 4 / 3
"""Width to height of the game picture as a television shows it (its 160 × 210 pixels are wide);
the border, being a share of each side, keeps the whole projected picture at the same ratio."""

_FAR = 1 + BORDER
_SPAN = 1 + 2 * BORDER

GAME_IN_PICTURE: NDArray[np.float32] = (
    np.array([[BORDER, BORDER], [_FAR, BORDER], [_FAR, _FAR], [BORDER, _FAR]], np.float32) / _SPAN
)
"""Corners of the game in the projected picture, whose own corners are (0, 0) to (1, 1):
``float32 [4, 2]`` (x, y), from the top left clockwise."""
