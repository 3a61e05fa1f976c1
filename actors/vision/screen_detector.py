"""The screen detector: takes a camera picture and returns a frame of the state.

As in the system of 2017, the largest black quadrilateral is the projected picture, which contains
the game. The game's place in it is known (`layout`) and not detected: a game such as Asteroids is
black to its edge, so its own outline is invisible, but the border's outer edge never is. A border
that is dark all round confirms the detection.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.vision.edges import refine
from actors.vision.field_of_view import WIDTH_ANGLE
from actors.vision.layout import ASPECT, GAME_IN_PICTURE
from actors.vision.lens import Lens
from actors.vision.pinhole import PinholeView
from actors.vision.quad import dark_quads
from actors.vision.screen import Screen, homography_to
from common.protocol.step_fields import FRAME_SHAPE

_DARK = 0.4
"""Threshold between black (0) and light (1) below which a pixel is dark."""
_DARKS = (_DARK, 0.6, 0.75)
"""Thresholds tried in the whole picture: ambient light lifts the picture's black above the black of
other objects."""
_MIN_CONTRAST = 30.0
"""Minimum difference between black and light, in grey levels."""
_BESIDE = 32
"""Places inside each side of the edge, and as many outside, that should be dark and light."""
_BESIDE_RIGHT = 0.7
_SIDE_RIGHT = 0.4
"""Minimum share of the whole edge, and of each side, that is dark inside and light outside; arms
may hide the rest."""
_ASPECT_ERROR = 0.012
"""Maximum relative error of the screen's ratio of width to height."""
_SKEW = 0.012
"""Maximum cosine between the screen's sides. Correct detections, noise and blur included, stay
within half of both bounds; one whose hidden corner is wrong by 2 pixels does not."""
_UNMOVED = 0.9
"""Minimum share of the screen's outline in place for which the search is skipped."""
_EDGE = 0.25
"""Minimum fall of light at an edge, as a share of the whole picture's contrast."""


class Detection(NamedTuple):
    """The game as detected in one camera picture."""

    frame: NDArray[np.uint8]
    """Grey game picture, ``uint8 [84, 84]``; zeros before the first detection."""
    valid: bool
    """Whether the screen was found in this picture."""
    corners: NDArray[np.float32] | None
    """Corners of the game picture in camera pixels, ``float32 [4, 2]`` (x, y), clockwise from the
    top left; pixel centres lie at whole numbers. None before the first detection."""


class ScreenDetector:
    """Finds the projection screen and unwarps the game.

    While the screen stands still and nothing covers its edges, it is not searched again. If it is
    neither found nor confirmed at its last place, the last good homography is used and the frame is
    marked invalid.
    """

    def __init__(self, distortion: float = 0.0) -> None:
        """``distortion`` is the k₁ of the camera's lens, known from calibration."""
        self._distortion = distortion
        self._lens: Lens | None = None
        self._screen: Screen | None = None
        self._corners: NDArray[np.float32] | None = None

    def detect(self, image: NDArray[np.uint8]) -> Detection:
        """Detects the game in an RGB picture, ``uint8 [height, width, 3]``, always of the same
        size."""
        if self._distortion > 0 and self._lens is None:
            self._lens = Lens(self._distortion, (image.shape[1], image.shape[0]))
        view = PinholeView(image, self._lens)
        last, windowed = self._screen, None
        if last is not None:
            windowed = view.part(last.window)
            if last.is_still_in(windowed):
                return Detection(last.unwarp(windowed), True, self._corners)
        found = self._search(view)
        if self._screen is None:
            return Detection(np.zeros(FRAME_SHAPE, np.uint8), False, None)
        if windowed is None or self._screen is not last:
            windowed = view.part(self._screen.window)
        return Detection(self._screen.unwarp(windowed), found, self._corners)

    def _search(self, view: PinholeView) -> bool:
        """Finds the screen or confirms its last place; returns whether either succeeded."""
        black, light = _levels(view.as_taken)
        if light - black < _MIN_CONTRAST:
            return False
        last, shares = None, np.zeros(4)
        if self._screen is not None:
            last = self._screen.outer
            near = view.around(self._screen.around)
            shares = self._screen.outline.in_place(near, _EDGE * (light - black))
            if shares.mean() >= _UNMOVED:
                return True
        outer = _find(view.whole, last, black, light)
        if outer is None:
            # Too much may be hidden to find it, but a screen that moved cannot have three sides in
            # place.
            return bool((shares >= _SIDE_RIGHT).sum() >= 3)
        self._screen = Screen(outer, view.whole)
        self._corners = corners = self._screen.corners
        if self._lens is not None:  # give the corners in the distorted camera picture
            self._corners = self._lens.bend(corners.astype(np.float64)).astype(np.float32)
        return True


def _levels(grey: NDArray[np.uint8]) -> tuple[float, float]:
    """Returns the grey levels of black and of light in a picture."""
    sample = grey[::4, ::4].ravel()
    places = len(sample) // 50, len(sample) * 9 // 10
    black, light = np.partition(sample, places)[list(places)].tolist()
    return float(black), float(light)


def _find(
    grey: NDArray[np.uint8], last: NDArray[np.float32] | None, black: float, light: float
) -> NDArray[np.float32] | None:
    """Returns corners of the projected picture, border included, or None.

    The last place is tried first: an object in front of the screen can spoil its outline, but not
    all of its edges.
    """
    contrast = _EDGE * (light - black)
    if last is not None and (outer := _confirm(grey, last, contrast)) is not None:
        return outer
    smooth = cv2.blur(grey, (3, 3))
    for share in _DARKS:
        limit = black + share * (light - black)
        dark = cv2.threshold(smooth, limit, 255, cv2.THRESH_BINARY_INV)[1]
        quads = dark_quads(np.asarray(dark, np.uint8))
        found = [outer for quad in quads if (outer := _confirm(grey, quad, contrast)) is not None]
        if found:
            # A hand's edge beside the game can make a smaller quadrilateral, but not a larger one.
            return max(found, key=lambda outer: float(cv2.contourArea(outer)))
    return None


def _confirm(
    grey: NDArray[np.uint8], quad: NDArray[np.float32], contrast: float
) -> NDArray[np.float32] | None:
    """Returns ``quad`` refined to a fraction of a pixel; None if it is not a projected picture."""
    outer = refine(grey, quad, contrast)
    if outer is None:
        return None
    height, width = grey.shape
    if outer.min() < 0 or (outer > (width - 1, height - 1)).any():
        return None
    homography = homography_to(outer)
    if not _is_picture_shaped(homography, width, height):
        return None
    places = cv2.perspectiveTransform(_BESIDE_EDGE, homography).round().astype(int)
    x, y = np.clip(places, 0, (width - 1, height - 1)).transpose(2, 0, 1)
    border, around = grey[y, x].astype(np.float64)
    black, light = np.percentile(border, 25), np.median(around)
    if light - black < _MIN_CONTRAST:
        return None
    # Both are needed: a dark hand in front of a side has no light outside its own edge.
    for right in (
        border < black + _DARK * (light - black),
        around > light - _DARK * (light - black),
    ):
        sides = right.reshape(4, -1).mean(axis=1)
        if sides.mean() < _BESIDE_RIGHT or sides.min() < _SIDE_RIGHT:
            return None
    return outer


def _is_picture_shaped(homography: NDArray[np.float64], width: int, height: int) -> bool:
    """Whether the camera could see a rectangle of the projector's shape as this homography.

    The homography's first two columns are projections of the plane's axes (Zhang 2000).
    """
    focal = width / 2 / np.tan(np.radians(WIDTH_ANGLE) / 2)
    across, down = homography[:, 0].copy(), homography[:, 1].copy()
    for axis in (across, down):
        axis[0] = (axis[0] - (width - 1) / 2 * axis[2]) / focal
        axis[1] = (axis[1] - (height - 1) / 2 * axis[2]) / focal
    wide, tall = np.linalg.norm(across), np.linalg.norm(down)
    skew = abs(float(across @ down)) / (wide * tall)
    return bool(abs(wide / tall / ASPECT - 1) < _ASPECT_ERROR and skew < _SKEW)


def _beside_edge() -> NDArray[np.float32]:
    """Returns places in the projected picture, ``[2, places, 2]``: along the middle of the black
    border, and as many just outside it."""
    middle = float(GAME_IN_PICTURE[0, 0]) / 2
    rings = []
    for low in (middle, -middle / 2):
        along = np.linspace(low, 1 - low, _BESIDE)
        fixed = np.full(_BESIDE, low)
        sides = [(along, fixed), (fixed, along), (along, 1 - fixed), (1 - fixed, along)]
        rings.append(np.concatenate([np.stack(side, axis=1) for side in sides]))
    return np.asarray(rings, np.float32)


_BESIDE_EDGE = _beside_edge()
