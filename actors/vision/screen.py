"""A detected projection screen: its place, its unwarping, and the check that it has not moved."""

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.vision.edges import REACH, Outline
from actors.vision.layout import GAME_IN_PICTURE, UNIT_SQUARE
from actors.vision.window import window_around
from common.protocol.step_fields import FRAME_SHAPE

FINER = 2
"""Oversampling: the game is unwarped this much finer than its frame and then averaged. A ball of
two pixels survives, as it does in the emulator's own frame."""
_OUTSIDE = 0.03
_INSIDE = 0.6
"""Limits of the band that has to stay the same: `_OUTSIDE` outside the picture, as a share of its
size, and `_INSIDE` into the border, as a share of its width. The game cannot change this band."""


class Screen:
    """A screen at its place in the picture in which it was detected.

    While the band along its edges is identical, bit for bit, nothing has moved or covered it, and a
    new search would find the same. Comparing the band takes a fortieth of the time of a search.
    """

    def __init__(self, outer: NDArray[np.float32], grey: NDArray[np.uint8]) -> None:
        """``outer [4, 2]`` are the projected picture's corners (x, y), border included, clockwise
        from the top left, in the camera picture ``grey uint8 [height, width]``."""
        self.outer = outer
        homography = homography_to(outer)
        corners = cv2.perspectiveTransform(GAME_IN_PICTURE[None], homography)[0]
        self.corners: NDArray[np.float32] = np.asarray(corners, np.float32)
        """Corners of the game, ordered as ``outer``."""
        edges = cv2.perspectiveTransform(_BAND, homography)
        self.window = window_around(edges[0], grey.shape)
        """Rows and columns that the methods need of a picture."""
        self.outline = Outline(outer)
        """The picture's sides."""
        self.around = window_around(outer, grey.shape, more=REACH + 1)
        """Rows and columns in which `outline` looks."""
        top, left = (each.start for each in self.window)
        known = grey[self.window]
        self._band = _band_in(edges - (left, top), known.shape)
        self._known = known.take(self._band)
        to_window = np.array([[1, 0, -left], [0, 1, -top], [0, 0, 1]])
        self._window_of_fine = to_window @ homography @ _PICTURE_OF_FINE

    def is_still_in(self, windowed: NDArray[np.uint8]) -> bool:
        """Whether the band along the edges is identical in another picture's `window`."""
        return np.array_equal(windowed.take(self._band), self._known)

    def unwarp(self, windowed: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Returns the game in a picture's `window`, ``uint8 [84, 84]``."""
        height, width = FRAME_SHAPE
        fine = cv2.warpPerspective(
            windowed,
            self._window_of_fine,
            (width * FINER, height * FINER),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        )
        frame = cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA)
        return np.asarray(frame, np.uint8)


def _band_in(edges: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Returns indices into a flattened picture of the band's pixels, which lie between the
    quadrilaterals ``edges [2, 4, 2]``."""
    mask = np.zeros(shape, np.uint8)
    for quad, inside in zip(np.rint(edges).astype(np.int32), (1, 0), strict=True):
        cv2.fillConvexPoly(mask, quad, inside)
    return np.flatnonzero(mask)


def homography_to(outer: NDArray[np.float32]) -> NDArray[np.float64]:
    """Returns the map from the projected picture, (0, 0) to (1, 1), to camera pixels, ``[3,
    3]``."""
    return np.asarray(cv2.getPerspectiveTransform(UNIT_SQUARE, outer), np.float64)


def _picture_of_fine() -> NDArray[np.float64]:
    """Returns the map from pixels of the oversampled game to the projected picture, ``[3, 3]``."""
    (left, top), (right, bottom) = GAME_IN_PICTURE[0], GAME_IN_PICTURE[2]
    per_x, per_y = (
        (right - left) / FRAME_SHAPE[1] / FINER,
        (bottom - top) / FRAME_SHAPE[0] / FINER,
    )
    # Shifted by half a pixel: the game ends at its outermost pixels' edges, not at their centres.
    return np.array([[per_x, 0, left + per_x / 2], [0, per_y, top + per_y / 2], [0, 0, 1]])


def _band() -> NDArray[np.float32]:
    """Returns the band's outer and inner corners in the projected picture, ``[2, 4, 2]``."""
    away = np.array([-_OUTSIDE, _INSIDE * GAME_IN_PICTURE[0, 0]])[:, None, None]
    return np.asarray(UNIT_SQUARE + away * (1 - 2 * UNIT_SQUARE), np.float32)


_PICTURE_OF_FINE = _picture_of_fine()
_BAND = _band()
