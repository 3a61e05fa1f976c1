"""Formats of figures for people: aligned, with separators, and a dash for unknown values."""

import math
import re
from collections.abc import Callable
from functools import partial
from typing import Any

from common.metrics import METRICS, Values, number
from common.minus import minus_signed
from common.protocol.run_status import HealthCheck

UNKNOWN = "–"


def ended(leaving: bool) -> str:
    """Returns the word for a process that is not alive."""
    return "left" if leaving else "lost"


def decimal(value: float, places: int) -> str:
    """Returns a number with ``places`` decimals and a minus sign as wide as a digit."""
    return minus_signed(f"{value:,.{places}f}") if math.isfinite(value) else str(value)


def significant(value: float) -> str:
    """Returns a number of any magnitude with four digits: ``0.0008297``, ``12.40``, ``4.1e-07``,
    ``0``."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    if 1e-4 <= abs(value) < 1e6:
        return decimal(value, max(3 - math.floor(math.log10(abs(value))), 0))
    return minus_signed(f"{value:.1e}")


def reading(check: HealthCheck) -> str:
    """Returns the value of a health check; whole numbers of one that must have none, such as
    "skipped updates = 0", without decimals."""
    if check.bound.startswith("=") and check.value is not None and check.value % 1 == 0:
        return f"{check.value:,.0f}"
    return written("significant", check.value)


def reading_and_bound(check: HealthCheck) -> str:
    """Returns value and bound of a red health check: ``90.00, not ≤ 66``, ``10, not 0``."""
    return f"{reading(check)}, not {check.bound.removeprefix('= ')}"


def share(done: float, total: float) -> str:
    """Returns the share of ``done`` in ``total`` in whole per cent, never rounded up to 100."""
    return f"{math.floor(100 * min(done / total, 1)) if total else 0} %"


def per_cent(share: float, places: int = 0) -> str:
    """Returns a share in per cent, with so many decimals: ``98 %``."""
    return f"{100 * share:.{places}f} %"


def cores(busy: float) -> str:
    """Returns busy cores in per cent of one core: ``98 % CPU``."""
    return f"{per_cent(busy)} CPU"


def taken(busy: float, memory: int) -> str:
    """Returns a process's use of processor and memory: ``98 % CPU, 277 MB``."""
    return f"{cores(busy)}, {size(memory)}"


def game_of(values: Values) -> str:
    """Returns the Atari game that is played; nothing of an environment that has none."""
    game = values["run/game"]
    return "" if game == values["run/env"] else str(game)


def played(values: Values) -> str:
    """Returns what a run plays: ``pong (robot)``."""
    return fill("{run/game} ({run/env})" if game_of(values) else "{run/env}", values)


def scores(values: Values) -> str:
    """Returns a line of a run's scores."""
    of = " (epoch {play/test_epoch})" if values.get("play/test_epoch") is not None else ""
    return fill(
        f"score: training {{play/train_reward}}, test {{play/test_reward}}{of}, best test "
        "{play/best_test_reward}, random {play/random_reward}",
        values,
    )


def hardware(values: Values) -> str:
    """Returns the learner's device, and its use of processor, memory and GPU."""
    busy, memory = (number(values, f"run/{name}") for name in ("busy_cores", "memory_bytes"))
    parts = [f"{values['run/device']}"]
    if busy is not None and memory is not None:
        parts.append(taken(busy, int(memory)))
    return ", ".join(parts + gpu(values))


def gpu(values: Values) -> list[str]:
    """Returns the use of the GPU: ``["GPU 83 %", "1,870 of 81,559 MB"]``; nothing without one."""
    names = ("utilisation", "memory_bytes", "capacity_bytes")
    busy, memory, capacity = (number(values, f"run/gpu_{name}") for name in names)
    if memory is None or capacity is None:
        return []
    told = f"{size(int(memory)).removesuffix(' MB')} of {size(int(capacity))}"
    return [f"GPU {told}"] if busy is None else [f"GPU {per_cent(busy)}", told]


def size(count: int) -> str:
    """Returns a number of bytes as ``277 MB``."""
    return f"{count / 1e6:,.0f} MB"


def duration(seconds: float) -> str:
    """Returns seconds as ``12:45``, ``3:12:45`` or ``2 d 03:12``."""
    whole = max(int(seconds), 0)
    days, hours, minutes = whole // 86_400, whole // 3_600 % 24, whole // 60 % 60
    if days:
        return f"{days} d {hours:02}:{minutes:02}"
    if hours:
        return f"{hours}:{minutes:02}:{whole % 60:02}"
    return f"{minutes:02}:{whole % 60:02}"


FORMS: dict[str, Callable[[Any], str]] = {
    **{f".{places}": partial(decimal, places=places) for places in range(4)},
    "count": "{:,}".format,
    "duration": duration,
    "ms": lambda value: "∞" if value == math.inf else decimal(value, 0),  # what was not reached
    "plain": "{:g}".format,
    "significant": significant,
    "text": str,
}
"""Functions that format a value, by the names in `common.metrics.Metric.form`."""


def written(form: str, value: Any) -> str:
    """Returns ``value`` in one of `FORMS`; a dash if it is unknown."""
    return UNKNOWN if value is None else FORMS[form](value)


def figure(key: str, values: Values) -> str:
    """Returns the figure ``key`` in its own form."""
    return written(METRICS[key].form, values.get(key))


def fill(template: str, values: Values) -> str:
    """Returns ``template`` with each ``{key}`` replaced by its figure."""
    return re.sub(r"\{([^{}]+)\}", lambda found: figure(found[1], values), template)


def one_line(text: str) -> str:
    """Returns ``text`` without line ends and control characters, which would break the screen."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())
