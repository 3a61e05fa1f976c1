"""Fine search: locates the sides of a dark quadrilateral to a fraction of a pixel.

Each side is sampled across at many places. A line is fitted to the places where light falls to
dark, so noise, pixel stairs and a hand in front of the screen have little effect. OpenCV's
cornerSubPix uses only the corners, which are hidden most often.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.vision.quad import meet

_PLACES = 24
"""Sampled places per side."""
REACH = 6
"""Pixels sampled on either side of the rough edge."""
_NEAR = 0.8
"""Maximum distance, pixels, of a place from the line that it supports: pixel stairs are ±0.5."""
_SUPPORT = 0.4
"""Minimum share of a side's places that must support its line."""

_ALONG = np.linspace(0.04, 0.96, _PLACES)[:, None]
_ACROSS = np.arange(-REACH, REACH + 1, dtype=np.float64)


def refine(
    grey: NDArray[np.uint8], quad: NDArray[np.float32], contrast: float
) -> NDArray[np.float32] | None:
    """Returns ``quad`` moved onto the edges where light outside falls to dark inside.

    Args:
        grey: Picture, ``uint8 [height, width]``.
        quad: Rough corners, clockwise, ``float32 [4, 2]``.
        contrast: Minimum fall of an edge, in grey levels.

    Returns:
        Corners, ``float32 [4, 2]``; None if a side has too little support.
    """
    bases, inward = _places(quad)
    offsets, found = _edges(grey, _samples(bases, inward), contrast)
    points = bases + inward[:, None] * offsets[:, :, None]
    lines = np.zeros((4, 3))
    for side in range(4):
        line = _fit(points[side][found[side]])
        if line is None:
            return None
        lines[side] = line
    return meet(lines)


class Outline:
    """The sides of an exact quadrilateral, ``quad [4, 2]``, which is checked again and again."""

    def __init__(self, quad: NDArray[np.float32]) -> None:
        self._samples = _samples(*_places(quad))

    def in_place(self, grey: NDArray[np.uint8], contrast: float) -> NDArray[np.float64]:
        """Returns the share of each side that is still in place, ``[4]``."""
        offsets, found = _edges(grey, self._samples, contrast)
        shares: NDArray[np.float64] = (found & (np.abs(offsets) < _NEAR)).mean(axis=1)
        return shares


def _places(quad: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns places along each side ``[4, places, 2]`` and each side's inward normal ``[4,
    2]``."""
    corners = quad.astype(np.float64)
    sides = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-sides[:, 1], sides[:, 0]], axis=1)
    inward /= np.maximum(np.hypot(sides[:, 0], sides[:, 1]), 1e-6)[:, None]
    return corners[:, None] + sides[:, None] * _ALONG, inward


def _samples(bases: NDArray[np.float64], inward: NDArray[np.float64]) -> NDArray[np.float32]:
    """Returns x and y of the samples across each place, ``float32 [2, 4 places, samples]``."""
    grid = (bases[:, :, None] + inward[:, None, None] * _ACROSS[:, None]).astype(np.float32)
    return np.ascontiguousarray(grid.reshape(4 * _PLACES, -1, 2).transpose(2, 0, 1))


def _edges(
    grey: NDArray[np.uint8], at: NDArray[np.float32], contrast: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Returns how far inward of each place its edge lies, pixels, and whether there is an edge.

    Both arrays are ``[4, places]``; ``at`` comes from `_samples`.
    """
    xs, ys = at
    samples = cv2.remap(grey, xs, ys, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    offsets, found = _falls(np.asarray(samples, np.float32), contrast)
    return offsets.reshape(4, _PLACES), found.reshape(4, _PLACES)


def _falls(
    samples: NDArray[np.float32], contrast: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Returns where each row of ``samples [n, 2 reach + 1]`` falls most, in pixels, and whether
    that is an edge."""
    fall = samples[:, :-3] + samples[:, 1:-2] - samples[:, 2:-1] - samples[:, 3:]
    start = np.argmax(fall, axis=1)
    rows = np.arange(len(samples))
    window = samples[rows[:, None], start[:, None] + np.arange(4)]
    high, low = window[:, 0], window[:, 3]
    drop = high - low
    # The area under a falling edge locates it whatever its blur; one threshold crossing does not.
    share = (window[:, 1] + window[:, 2] - 2 * low) / np.maximum(drop, 1e-6)
    offsets = start + 0.5 + np.clip(share, 0, 2) - REACH
    return offsets, drop >= contrast


def _fit(points: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Returns the line (a, b, c) that most points support, or None if too few do."""
    least = _SUPPORT * _PLACES
    if len(points) < least:
        return None
    line = _through(points)
    near = np.abs(points @ line[:2] + line[2]) < _NEAR
    if near.sum() < 0.9 * len(points):  # outliers have bent the line
        line = _best_pair(points)
        near = np.abs(points @ line[:2] + line[2]) < _NEAR
        if near.sum() < least:
            return None
    return _through(points[near])


def _through(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the least-squares line through the points."""
    dx, dy, x, y = cv2.fitLine(points.astype(np.float32), cv2.DIST_L2, 0, 0.01, 0.01).ravel()
    return np.array([-dy, dx, dy * x - dx * y], np.float64)


def _best_pair(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the line through two distant points that most other points support."""
    count = len(points)
    first, second = _PAIRS[:, (count > _PAIRS).all(axis=0)]
    directions = points[second] - points[first]
    normals = np.stack([-directions[:, 1], directions[:, 0]], axis=1)
    normals /= np.maximum(np.hypot(directions[:, 0], directions[:, 1]), 1e-6)[:, None]
    offsets = -np.sum(normals * points[first], axis=1)
    support = (np.abs(normals @ points.T + offsets[:, None]) < _NEAR).sum(axis=1)
    best = int(np.argmax(support))
    return np.array([*normals[best], offsets[best]])


_PAIRS = np.array([(i, j) for i in range(_PLACES) for j in range(i + _PLACES // 3, _PLACES, 2)]).T
"""Pairs to try, ``[2, n]``: at least a third of the side apart, so that noise turns them little."""
