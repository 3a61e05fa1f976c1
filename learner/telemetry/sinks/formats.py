"""How figures are written for people: aligned, with separators, and a dash for the unknown."""

import math
import re
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

from common.metrics import METRICS, Values

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


def milliseconds(value: float | None) -> str:
    """Whole ms; ``∞`` for what was not reached."""
    return "∞" if value == math.inf else decimal(value, 0)


FORMS: dict[str, Callable[[Any], str]] = {
    **{f".{places}": partial(decimal, places=places) for places in range(4)},
    "count": count,
    "duration": duration,
    "ms": milliseconds,
    "of epoch": lambda value: "" if value is None else f", epoch {value}",
    "plain": lambda value: UNKNOWN if value is None else f"{value:g}",
    "significant": significant,
    "text": lambda value: UNKNOWN if value is None else str(value),
}
"""By the name that `common.metrics.Metric.form` has."""


def figure(key: str, values: Values) -> str:
    """The figure ``key`` in its own form."""
    return FORMS[METRICS[key].form](values.get(key))


def fill(template: str, values: Values) -> str:
    """``template`` with each ``{key}`` replaced by its figure."""
    return re.sub(r"\{([^{}]+)\}", lambda found: figure(found[1], values), template)


def troubles(values: Values) -> str:
    """What went wrong with time, if anything did, each after a comma: ``, 12k late, 3 gave up``."""
    sums: dict[str, int] = {}
    for key, value in values.items():
        if (word := METRICS[key].trouble) and isinstance(value, int):
            sums[word] = sums.get(word, 0) + value
    return "".join(f", {_brief(total)} {word}" for word, total in sums.items() if total)


def _brief(number: int) -> str:
    """In four characters: at 80 columns there is no room for more."""
    for unit, name in ((1_000_000, "M"), (1_000, "k")):
        if number >= unit:
            return f"{number / unit:.{1 if number < 10 * unit else 0}f}{name}"
    return str(number)


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
