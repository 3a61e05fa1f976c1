"""Charts of block characters, for the screen."""

from collections.abc import Sequence

import numpy as np

_LEVELS = " ▁▂▃▄▅▆▇█"


def columns_of(values: Sequence[float], width: int) -> list[float]:
    """Returns ``values`` for a chart of ``width`` columns: averaged if many, repeated if few."""
    if len(values) > width:
        return [float(part.mean()) for part in np.array_split(values, max(width, 1))]
    return [value for value in values for _ in range(min(width // len(values), 3))]


def bars(values: Sequence[float], low: float, high: float, rows: int) -> list[str]:
    """Returns a bar chart of block characters, top row first; the bar of ``low`` is one eighth of a
    row high."""
    steps = rows * 8
    heights = [
        1 + round((steps - 1) * min(max((value - low) / (high - low), 0.0), 1.0))
        if high > low
        else steps // 2
        for value in values
    ]
    return [
        "".join(_LEVELS[min(max(height - 8 * row, 0), 8)] for height in heights)
        for row in reversed(range(rows))
    ]
