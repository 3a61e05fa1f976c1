"""Rough search: the biggest dark quadrilateral in a picture, within a few pixels."""

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

_MIN_SHARE = 0.02
"""Least share of the picture that the projected picture fills; smaller, 84×84 would be blurred."""
_CANDIDATES = 2
"""Dark regions tried, biggest first: robot and furniture may be dark and bigger than the screen."""


def dark_quads(dark: NDArray[np.uint8]) -> Iterator[NDArray[np.float32]]:
    """Quadrilaterals of the biggest regions of ``dark``, biggest first.

    Args:
        dark: 255 where the picture is dark, else 0, ``uint8 [height, width]``.

    Yields:
        Corners (x, y) in pixels, ``float32 [4, 2]``, from the top left clockwise.
    """
    contours, _ = cv2.findContours(dark, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    least = _MIN_SHARE * dark.size
    boxes = [(w * h, i) for i, (_, _, w, h) in enumerate(map(cv2.boundingRect, contours))]
    for area, index in sorted(boxes, reverse=True)[:_CANDIDATES]:
        if area < least:
            return
        quad = _four_sides(np.asarray(contours[index], np.int32))
        if quad is not None:
            yield quad


def _four_sides(contour: NDArray[np.int32]) -> NDArray[np.float32] | None:
    """The quadrilateral of the contour's four longest sides.

    The hull bridges what stands before a side, and a corner that is hidden or cut off is where
    the two long sides beside it meet.
    """
    hull = cv2.convexHull(contour)
    polygon = cv2.approxPolyDP(hull, 0.01 * cv2.arcLength(hull, True), True)
    points = polygon.reshape(-1, 2).astype(np.float64)
    if len(points) < 4:
        return None
    sides = np.roll(points, -1, axis=0) - points
    longest = np.sort(np.argsort(-np.hypot(sides[:, 0], sides[:, 1]))[:4])
    lines = _lines(points[longest], sides[longest])
    quad = meet(lines)
    if quad is None:
        return None
    # The sides cannot be the picture's if they enclose much more or less than is dark.
    filled = cv2.contourArea(hull) / max(cv2.contourArea(quad), 1.0)
    return from_top_left(quad) if 0.7 < filled < 1.1 else None


def _lines(points: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lines a·x + b·y + c = 0 through points, ``float64 [n, 3]``."""
    normals = np.stack([-directions[:, 1], directions[:, 0]], axis=1)
    return np.column_stack([normals, -np.sum(normals * points, axis=1)])


def meet(lines: NDArray[np.float64]) -> NDArray[np.float32] | None:
    """Corners between each of four lines (a, b, c) and the one before; None if not convex."""
    corners = np.cross(np.roll(lines, 1, axis=0), lines)
    if np.abs(corners[:, 2]).min() < 1e-9 * np.abs(corners).max():
        return None
    quad = (corners[:, :2] / corners[:, 2:]).astype(np.float32)
    return quad if cv2.isContourConvex(quad) else None


def from_top_left(quad: NDArray[np.float32]) -> NDArray[np.float32]:
    """The corners clockwise as seen, from the top left one; NAO's neck cannot roll its head."""
    x, y = quad[:, 0], quad[:, 1]
    if np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) < 0:
        quad = quad[::-1]
    return np.roll(quad, -int(np.argmin(quad.sum(axis=1))), axis=0)
