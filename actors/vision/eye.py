"""What the robot sees of its game: the camera picture in, a frame of the state out.

As in the report: the biggest black quadrilateral is the projected picture, in it lies the game.
Where in it is not looked for but known (`layout`): a game like Asteroids is black to its very
edge, so that its own outline cannot be seen, while the border's outer edge always can. That the
border is black all round then confirms that the quadrilateral is a projected picture.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.vision.edges import refine
from actors.vision.layout import GAME_IN_PICTURE
from actors.vision.quad import dark_quads
from common.chunk import FRAME_SHAPE

_DARK = 0.4
"""A pixel is dark below this share of the way from the picture's black to its bright wall."""
_MIN_CONTRAST = 30.0
"""Grey levels between black and wall below which there is nothing to see."""
_BORDER_DARK = 0.7
"""Least share of the border that is dark; arms may hide the rest."""
_FINER = 2
"""The game is unwarped this much finer than its frame and then averaged, which keeps a ball of
two pixels as the emulator's own frame does."""


class Sight(NamedTuple):
    """The game as seen in one camera picture."""

    frame: NDArray[np.uint8]
    """Grey game picture, ``uint8 [84, 84]``; zeros before the screen was ever found."""
    valid: bool
    """The screen was found in this very picture."""
    corners: NDArray[np.float32] | None
    """Pixel corners of the game picture used, ``float32 [4, 2]`` (x, y), from the top left
    clockwise; pixel centres lie at whole numbers. None before the first screen was found."""


class Eye:
    """Finds the projector screen and unwarps the game.

    When it finds nothing it goes on with the last good homography and marks the frame invalid.
    """

    def __init__(self) -> None:
        self._outer: NDArray[np.float32] | None = None
        self._homography: NDArray[np.float64] | None = None

    def see(self, image: NDArray[np.uint8]) -> Sight:
        """Look at a camera picture, ``uint8 [height, width, 3]`` RGB."""
        grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
        outer = self._find(grey)
        if outer is not None:
            self._outer = outer
            self._homography = _homography_to(outer)
        if self._homography is None:
            return Sight(np.zeros(FRAME_SHAPE, np.uint8), False, None)
        corners = np.asarray(
            cv2.perspectiveTransform(GAME_IN_PICTURE[None], self._homography)[0], np.float32
        )
        return Sight(_unwarp(grey, self._homography), outer is not None, corners)

    def _find(self, grey: NDArray[np.uint8]) -> NDArray[np.float32] | None:
        """Corners of the projected picture, border included, or None."""
        sample = np.sort(grey[::4, ::4], axis=None)
        black, wall = float(sample[len(sample) // 50]), float(sample[len(sample) * 9 // 10])
        if wall - black < _MIN_CONTRAST:
            return None
        limit = black + _DARK * (wall - black)
        dark = np.asarray(cv2.threshold(grey, limit, 255, cv2.THRESH_BINARY_INV)[1], np.uint8)
        for quad in dark_quads(dark):
            if (outer := self._confirm(grey, dark, quad, wall - black)) is not None:
                return outer
        # Something dark before the screen can spoil its outline, not all of its edges.
        if self._outer is not None:
            return self._confirm(grey, dark, self._outer, wall - black)
        return None

    @staticmethod
    def _confirm(
        grey: NDArray[np.uint8], dark: NDArray[np.uint8], quad: NDArray[np.float32], span: float
    ) -> NDArray[np.float32] | None:
        outer = refine(grey, quad, 0.25 * span)
        if outer is None:
            return None
        height, width = grey.shape
        if outer.min() < 0 or (outer > (width - 1, height - 1)).any():
            return None
        border = cv2.perspectiveTransform(_BORDER_MIDDLE[None], _homography_to(outer))[0]
        x, y = border.round().astype(int).T
        return outer if np.mean(dark[y, x] > 0) >= _BORDER_DARK else None


def _homography_to(outer: NDArray[np.float32]) -> NDArray[np.float64]:
    """From a place in the projected picture, (0, 0) to (1, 1), to its pixel."""
    return np.asarray(cv2.getPerspectiveTransform(_UNIT_SQUARE, outer), np.float64)


def _unwarp(grey: NDArray[np.uint8], homography: NDArray[np.float64]) -> NDArray[np.uint8]:
    height, width = FRAME_SHAPE
    fine = cv2.warpPerspective(
        grey,
        homography @ _PICTURE_OF_FINE,
        (width * _FINER, height * _FINER),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
    )
    frame = cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(frame, np.uint8)


def _picture_of_fine() -> NDArray[np.float64]:
    """From a pixel of the fine game picture to its place in the projected picture."""
    (left, top), (right, bottom) = GAME_IN_PICTURE[0], GAME_IN_PICTURE[2]
    per_x, per_y = (
        (right - left) / FRAME_SHAPE[1] / _FINER,
        (bottom - top) / FRAME_SHAPE[0] / _FINER,
    )
    # Half a pixel: the game ends at its outermost pixels' edges, not at their centres.
    return np.array([[per_x, 0, left + per_x / 2], [0, per_y, top + per_y / 2], [0, 0, 1]])


def _border_middle(count: int = 32) -> NDArray[np.float32]:
    """Places all along the middle of the black border, in the projected picture."""
    low = float(GAME_IN_PICTURE[0, 0]) / 2
    along = np.linspace(low, 1 - low, count)
    sides = [
        np.stack(pair, axis=1)
        for fixed in (np.full(count, low), np.full(count, 1 - low))
        for pair in ((along, fixed), (fixed, along))
    ]
    return np.concatenate(sides).astype(np.float32)


_UNIT_SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
_PICTURE_OF_FINE = _picture_of_fine()
_BORDER_MIDDLE = _border_middle()
