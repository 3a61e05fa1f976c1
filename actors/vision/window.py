"""Windows: the rows and columns of a part of a picture."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Window = tuple[slice, slice]
"""Rows and columns."""


def within(start: int, stop: int, size: int) -> slice:
    """Returns the part of ``start`` to ``stop`` that lies within ``size`` pixels.

    If there is none, it returns the nearest pixel, because OpenCV takes no empty picture.
    """
    first = min(max(start, 0), size - 1)
    return slice(first, max(min(stop, size), first + 1))


def window_around(points: NDArray[Any], shape: tuple[int, ...], more: int = 0) -> Window:
    """Returns the window around ``points [N, 2]`` (x, y), enlarged by ``more`` pixels on each side.

    It is clipped with `within` to a picture of ``shape`` (rows, columns).
    """
    left, top = (np.floor(points.min(axis=0)).astype(int) - more).tolist()
    right, bottom = (np.ceil(points.max(axis=0)).astype(int) + 1 + more).tolist()
    return within(top, bottom, shape[0]), within(left, right, shape[1])
