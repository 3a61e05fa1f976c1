"""Rough search: finds quadrilaterals in the dark regions of a picture, to a few pixels.

A region's outline is cut into straight pieces. The direction of the dark side assigns each piece to
the top, right, bottom or left. Pieces on one line count together, so a hand in front of a side only
shortens it. Lines with the longest outline are tried first. A dark object that merges with the
picture only adds pieces.
"""

from collections.abc import Iterator
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

_MIN_SHARE = 0.02
"""Minimum share of the camera picture for a screen; a smaller one would blur the 84×84 frame."""
_REGIONS = 2
"""Dark regions tried, largest first: robot and furniture may be dark and larger than the screen."""
_ROUGH = 2.0
"""Maximum deviation of a straight piece from the outline, pixels."""
_SHORTEST = 8.0
"""Minimum length of a piece, pixels; shorter pieces are noise."""
_NEAR = 3.0
"""Maximum distance of a piece's ends from the line that it counts for, pixels."""
_LINES = 3
"""Lines tried for each side."""
_QUADS = 6
"""Quadrilaterals tried for each region."""
_LEAST_OUTLINE = 0.3
"""Minimum share of a quadrilateral's outline that the region's outline covers."""
_BEYOND = 0.1
"""Distance that a rough corner may lie outside, as a share of the picture's size."""
_NARROWEST, _WIDEST = 0.7, 2.5
"""Bounds of the ratio of width to height."""


def dark_quads(dark: NDArray[np.uint8]) -> Iterator[NDArray[np.float32]]:
    """Yields quadrilaterals in the largest regions of ``dark``, the likeliest of each region first.

    Args:
        dark: 255 where the picture is dark, 0 elsewhere, ``uint8 [height, width]``.

    Yields:
        Corners (x, y) in pixels, ``float32 [4, 2]``, clockwise from the top left.
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
        points = points[::-1]  # clockwise in the picture: the dark is to the right
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
        # `meet` returns the corner between each line and the previous one.
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
"""(a, b, c) of a·x + b·y + c = 0, and the length of the outline on it, pixels."""


def _strongest(
    starts: NDArray[np.float64], ways: NDArray[np.float64], lengths: NDArray[np.float64]
) -> list[_Line]:
    """Returns the lines with the longest outline among one side's pieces."""
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
    return lines


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
    """Returns the corners between each of four lines (a, b, c) and the previous one.

    Returns None if they are not convex.
    """
    corners = np.cross(np.roll(lines, 1, axis=0), lines)
    if np.abs(corners[:, 2]).min() < 1e-9 * np.abs(corners).max():
        return None
    quad = (corners[:, :2] / corners[:, 2:]).astype(np.float32)
    return quad if cv2.isContourConvex(quad) else None
