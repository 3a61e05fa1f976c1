"""How figures are written for people: aligned, with separators, and a dash for the unknown."""

import math
from collections.abc import Sequence
from itertools import pairwise

from common.press_latency import Delay

UNKNOWN = "–"
_LEVELS = " ▁▂▃▄▅▆▇█"


def count(value: int | None) -> str:
    """``1234567`` as ``1,234,567``."""
    return UNKNOWN if value is None else f"{value:,}"


def decimal(value: float | None, places: int) -> str:
    """A number with ``places`` decimals and a minus sign as wide as a digit."""
    if value is None:
        return UNKNOWN
    return f"{value:,.{places}f}".replace("-", "−") if math.isfinite(value) else str(value)


def significant(value: float | None, digits: int = 4) -> str:
    """A number of any magnitude: ``0.0008297``, ``12.40``, ``4.1e-07``, ``0``."""
    if value is None:
        return UNKNOWN
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    if 1e-4 <= abs(value) < 1e6:
        places = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
        return decimal(value, places)
    return f"{value:.{digits - 3}e}".replace("-", "−", int(value < 0))


def share(done: float, total: float) -> str:
    """``done`` of ``total`` in whole per cent, never rounded up to 100."""
    return f"{math.floor(100 * min(done / total, 1)) if total else 0} %"


def duration(seconds: float | None) -> str:
    """Seconds as ``12:45``, ``3:12:45`` or ``2 d 03:12``."""
    if seconds is None or not math.isfinite(seconds):
        return UNKNOWN
    whole = max(int(seconds), 0)
    days, hours, minutes = whole // 86_400, whole // 3_600 % 24, whole // 60 % 60
    if days:
        return f"{days} d {hours:02}:{minutes:02}"
    if hours:
        return f"{hours}:{minutes:02}:{whole % 60:02}"
    return f"{minutes:02}:{whole % 60:02}"


def delay(found: Delay) -> str:
    """p50 and p99 in ms as ``50/67``; ``50/>83`` or ``>83`` where it took longer than anybody
    waited."""
    if found.p50 is None or found.p99 is None:
        return UNKNOWN
    p99 = f"{found.p99:.0f}" if math.isfinite(found.p99) else f">{found.watched:.0f}"
    return f"{found.p50:.0f}/{p99}" if math.isfinite(found.p50) else p99


def one_line(text: str) -> str:
    """``text`` without line ends and control characters, which would break the screen."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def columns_of(values: Sequence[float], width: int) -> list[float]:
    """``values`` for a chart ``width`` columns wide: averaged when many, repeated when few."""
    size = len(values)
    if width < 1:
        return []
    if size > width:
        edges = [size * column // width for column in range(width + 1)]
        return [math.fsum(values[start:end]) / (end - start) for start, end in pairwise(edges)]
    repeat = min(width // size, 3) if size else 0
    return [value for value in values for _ in range(repeat)]


def bars(values: Sequence[float], low: float, high: float, rows: int) -> list[str]:
    """A bar chart of block characters, top row first; ``low`` is one eighth of a row high."""
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
