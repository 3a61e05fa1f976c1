"""Radial distortion of the robot's camera.

A point that a pinhole shows at distance r from the picture's centre appears at r', where
r = r'(1 + k₁r'²) in units of half the width: the first term of Brown's model of barrel distortion.
The simulated camera applies it, and the screen detector, which knows k₁ by calibration, undoes it.
"""

from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.vision.window import Window

_ALL: Window = (slice(None), slice(None))


class Lens:
    """A lens with distortion ``k1`` ≥ 0 for pictures of ``size`` (width, height)."""

    def __init__(self, k1: float, size: tuple[int, int]) -> None:
        self.k1 = k1
        self._size = width, height = size
        self._middle = np.array([(width - 1) / 2, (height - 1) / 2])
        self._half_width = width / 2
        corner = (self._middle**2).sum() / self._half_width**2
        grown = k1 * corner * self._middle
        self.margin: tuple[int, int] = (int(np.ceil(grown[0])), int(np.ceil(grown[1])))
        """Extra pixels beyond a pinhole picture's left and right, and upper and lower edges, which
        the lens brings into view."""

    # OpenCV's maps give, for each pixel of the result, its place in the source.

    @cached_property
    def _straight(self) -> "_Maps":
        return _maps(self.bend(_pixels(self._size)), self._size)

    @cached_property
    def _bent(self) -> "_Maps":
        return _maps(self.unbend(_pixels(self._size)) + self.margin, self._size)

    def unbend(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the pinhole's pixels of lens pixels ``points [N, 2]`` (x, y)."""
        away = (points - self._middle) / self._half_width
        square = (away**2).sum(axis=1, keepdims=True)
        ideal: NDArray[np.float64] = away * (1 + self.k1 * square) * self._half_width
        return self._middle + ideal

    def bend(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the lens's pixels of pinhole pixels ``points [N, 2]`` (x, y)."""
        away = (points - self._middle) / self._half_width
        ideal = np.hypot(away[:, 0], away[:, 1])
        # The only real root of a monotonic cubic.
        root = np.sqrt(3 * self.k1)
        bent = 2 / root * np.sinh(np.arcsinh(1.5 * root * ideal) / 3)
        nearer = (bent / np.maximum(ideal, 1e-12))[:, None]
        shown: NDArray[np.float64] = away * nearer * self._half_width
        return self._middle + shown

    def photograph(self, ideal: NDArray[np.uint8], window: Window = _ALL) -> NDArray[np.uint8]:
        """Returns a ``window`` of the lens's picture, made from a pinhole's ``ideal``.

        ``ideal`` is larger by `margin` on each side.
        """
        return _drawn(ideal, self._bent, window)

    def straighten(self, image: NDArray[np.uint8], window: Window = _ALL) -> NDArray[np.uint8]:
        """Returns a ``window`` of the pinhole's picture of the lens's ``image``."""
        return _drawn(image, self._straight, window)

    def shown(self, window: Window) -> Window:
        """Returns the window of the lens's picture that a ``window`` of the pinhole's affects.

        The pinhole's picture includes its `margin`.
        """
        # A pixel between two others is made of both.
        rows, columns = (np.arange(each.start - 1, each.stop + 1) for each in window)
        x, y = np.meshgrid(columns, rows)
        edge = (y == rows[0]) | (y == rows[-1]) | (x == columns[0]) | (x == columns[-1])
        seen = self.bend(np.stack([x[edge], y[edge]], axis=1).astype(float) - self.margin)
        low, high = np.floor(seen.min(axis=0)).astype(int), np.ceil(seen.max(axis=0)).astype(int)
        (left, top), (right, bottom) = low, high
        return slice(top, bottom + 1), slice(left, right + 1)


_Maps = tuple[NDArray[np.int16], NDArray[np.uint16]]


def _pixels(size: tuple[int, int]) -> NDArray[np.float64]:
    """Returns (x, y) of each pixel, row by row, ``float64 [width * height, 2]``."""
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    return np.stack([x, y], axis=2).reshape(-1, 2).astype(np.float64)


def _maps(points: NDArray[np.float64], size: tuple[int, int]) -> _Maps:
    x, y = points.astype(np.float32).reshape(size[1], size[0], 2).transpose(2, 0, 1)
    places, fractions = cv2.convertMaps(x, y, cv2.CV_16SC2)
    return np.asarray(places, np.int16), np.asarray(fractions, np.uint16)


def _drawn(image: NDArray[np.uint8], maps: _Maps, window: Window) -> NDArray[np.uint8]:
    places, fractions = (each[window] for each in maps)
    bent = cv2.remap(image, places, fractions, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(bent, np.uint8)
