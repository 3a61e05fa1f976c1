"""Rough search: quadrilaterals that dark regions of a picture may be, within a few pixels.

A region's outline is cut into straight pieces. The dark side of each tells whether it may belong
to the top, right, bottom or left side; pieces on one line count together, so that a hand in front
of a side only shortens it. Lines with the most outline on them are tried first. Something dark
that merges with the picture merely adds pieces.
"""

from collections.abc import Iterator
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

_MIN_SHARE = 0.02
"""Least share of the picture that the projected picture fills; smaller, 84×84 would be blurred."""
_REGIONS = 2
"""Dark regions tried, biggest first: robot and furniture may be dark and bigger than the screen."""
_ROUGH = 2.0
"""Pixels by which a straight piece may pass by its outline."""
_SHORTEST = 8.0
"""Pixels; shorter pieces are noise."""
_NEAR = 3.0
"""Pixels by which both ends of a piece may lie off the line that it counts for."""
_LINES = 3
"""Lines tried for each side."""
_QUADS = 6
"""Quadrilaterals tried of each region."""
_LEAST_OUTLINE = 0.3
"""Least share of a quadrilateral's outline that must be the region's."""
_BEYOND = 0.1
"""How far, as a share of the picture, a corner may lie outside: rough corners may."""
_NARROWEST, _WIDEST = 0.7, 2.5
"""Bounds of width to height."""


def dark_quads(dark: NDArray[np.uint8]) -> Iterator[NDArray[np.float32]]:
    """Quadrilaterals of the biggest regions of ``dark``, the likeliest of each first.

    Args:
        dark: 255 where the picture is dark, else 0, ``uint8 [height, width]``.

    Yields:
        Corners (x, y) in pixels, ``float32 [4, 2]``, from the top left clockwise.
    """
    contours, _ = cv2.findContours(dark, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    least = _MIN_SHARE * dark.size
    boxes = [(w * h, i) for i, (_, _, w, h) in enumerate(map(cv2.boundingRect, contours))]
    for area, index in sorted(boxes, reverse=True)[:_REGIONS]:
        if area < least:
            return
        yield from _quads(np.asarray(contours[index], np.int32), dark.shape)


def _quads(contour: NDArray[np.int32], shape: tuple[int, ...]) -> list[NDArray[np.float32]]:
    points = cv2.approxPolyDP(contour, _ROUGH, True).reshape(-1, 2).astype(np.float64)
    if cv2.contourArea(points.astype(np.float32), oriented=True) < 0:
        points = points[::-1]  # clockwise as seen, so that the dark is to the right of the way
    ways = np.roll(points, -1, axis=0) - points
    lengths = np.hypot(ways[:, 0], ways[:, 1])
    long = lengths >= _SHORTEST
    starts, ways, lengths = points[long], ways[long], lengths[long]
    x, y = ways[:, 0], ways[:, 1]
    level = np.abs(x) >= np.abs(y)
    tops, bottoms = level & (x > 0), level & (x < 0)
    rights, lefts = ~level & (y > 0), ~level & (y < 0)
    sides = [
        _strongest(starts[which], ways[which], lengths[which])
        for which in (tops, rights, bottoms, lefts)
    ]
    height, width = shape
    found: list[tuple[float, NDArray[np.float32]]] = []
    for chosen in product(*sides):
        top, right, bottom, left = chosen
        # `meet` gives the corner between each line and the one before.
        quad = meet(np.stack([line for line, _ in (top, right, bottom, left)]))
        if quad is None or not _plausible(quad, width, height):
            continue
        edges = np.linalg.norm(np.roll(quad, -1, axis=0) - quad, axis=1)
        outline = np.minimum(edges, [length for _, length in chosen]).sum() / edges.sum()
        if outline >= _LEAST_OUTLINE:
            found.append((float(outline), quad))
    found.sort(key=lambda pair: -pair[0])
    return [quad for _, quad in found[:_QUADS]]


_Line = tuple[NDArray[np.float64], float]
"""(a, b, c) of a·x + b·y + c = 0, and how many pixels of outline lie on it."""


def _strongest(
    starts: NDArray[np.float64], ways: NDArray[np.float64], lengths: NDArray[np.float64]
) -> list[_Line]:
    """The lines that have most outline on them, most first, of pieces of one side."""
    lines: list[_Line] = []
    left = np.ones(len(starts), bool)
    ends = starts + ways
    while left.any() and len(lines) < _LINES:
        seed = int(np.argmax(np.where(left, lengths, 0.0)))
        normal = np.array([-ways[seed, 1], ways[seed, 0]]) / lengths[seed]
        offset = normal @ starts[seed]
        away = np.maximum(np.abs(starts @ normal - offset), np.abs(ends @ normal - offset))
        on = left & (away < _NEAR)
        if on.sum() > 1:
            both = np.concatenate([starts[on], ends[on]]).astype(np.float32)
            dx, dy, px, py = cv2.fitLine(both, cv2.DIST_L2, 0, 0.01, 0.01).ravel()
            normal = np.array([-dy, dx], np.float64)
            offset = normal @ (px, py)
        lines.append((np.array([*normal, -offset]), float(lengths[on].sum())))
        left &= ~on
    return sorted(lines, key=lambda line: -line[1])


def _plausible(quad: NDArray[np.float32], width: int, height: int) -> bool:
    size = np.array([width, height])
    if (quad < -_BEYOND * size).any() or (quad > (1 + _BEYOND) * size).any():
        return False
    top, right, bottom, left = np.roll(quad, -1, axis=0) - quad
    across, down = (top - bottom) / 2, (right - left) / 2
    wide, tall = float(across[0]), float(down[1])
    if wide <= 0 or tall <= 0 or not _NARROWEST < wide / tall < _WIDEST:
        return False
    return float(cv2.contourArea(quad)) >= _MIN_SHARE * width * height


def meet(lines: NDArray[np.float64]) -> NDArray[np.float32] | None:
    """Corners between each of four lines (a, b, c) and the one before; None if not convex."""
    corners = np.cross(np.roll(lines, 1, axis=0), lines)
    if np.abs(corners[:, 2]).min() < 1e-9 * np.abs(corners).max():
        return None
    quad = (corners[:, :2] / corners[:, 2:]).astype(np.float32)
    return quad if cv2.isContourConvex(quad) else None
