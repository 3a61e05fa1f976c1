"""Formats of figures for people: aligned, with separators, and a dash for unknown values."""

import math
import re
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from common.metrics import METRICS, Metric, Values, number
from common.minus import minus_signed
from common.protocol.run_status import HealthCheck
from common.registry import ENVIRONMENTS

UNKNOWN = "–"
_LEVELS = " ▁▂▃▄▅▆▇█"


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


def metrics_of(env: object) -> list[Metric]:
    """Returns the metrics of the environment named ``env``; those of hands only for robots."""
    robot = ENVIRONMENTS.find(str(env)).robot
    return [metric for metric in METRICS.values() if robot or not metric.robot]


def panels_of(values: Values) -> dict[str, list[Metric]]:
    """Returns the metrics of each panel by its title, in the order in which they are shown."""
    panels: dict[str, list[Metric]] = {}
    for metric in metrics_of(values["run/env"]):
        if metric.panel:
            panels.setdefault(metric.panel[0], []).append(metric)
    for metrics in panels.values():
        metrics.sort(key=lambda metric: metric.panel or ())
    return panels


def short_label(metric: Metric) -> str:
    """Returns a figure's label without other figures in it: ``test`` for ``test, epoch {…}``."""
    return re.sub(r",[^,]*{[^}]*}", "", metric.label)


def label_and_text(metric: Metric, values: Values) -> tuple[str, str]:
    """Returns label and text of a figure in its panel."""
    known = values.get(metric.key) is not None
    label = fill(metric.label, values) if known else short_label(metric)
    return label, fill(metric.shown or f"{{{metric.key}}}", values)


class ProgressBar(NamedTuple):
    """One progress bar of the run."""

    label: str
    done: str
    """Key of the figure."""
    total: str
    """Key of its value when complete; that figure is unknown if there is no end."""
    note: str


def finishing_note(values: Values) -> str:
    """Returns what a run that has its steps still waits for: the tests of its last epochs."""
    if not values.get("evaluation/steps_left"):
        return "finishing"
    left = ", {run/seconds_left} left" if values.get("run/seconds_left") is not None else ""
    return fill(f"{{evaluation/steps_left}} test steps{left}", values)


def progress_of(values: Values) -> tuple[ProgressBar, ...]:
    """Returns the progress of phase, run and replay."""
    warm_up, finishing = (values["run/phase"] == phase for phase in ("warm-up", "finishing"))
    label = "Warm-up" if warm_up else f"Epoch {values['run/epoch']}"
    left = finishing_note(values) if finishing else fill("{run/seconds_left} left", values)
    ending = values.get("run/seconds_to_goal") is not None
    time = "{run/seconds}, {run/seconds_to_goal} left" if ending else "{run/seconds} so far"
    return (
        ProgressBar(label, "run/phase_steps", "run/phase_length", left),
        ProgressBar("Run", "run/agent_steps", "run/steps_goal", fill(time, values)),
        ProgressBar("Replay", "stream/stored", "stream/capacity", ""),
    )


def troubles(values: Values) -> str:
    """Returns the counts behind the number of actors, each after a comma: ``, 12k late``."""
    sums: dict[str, int] = {}
    for key, value in values.items():
        if (word := METRICS[key].trouble) and isinstance(value, int):
            sums[word] = sums.get(word, 0) + value
    return "".join(f", {_brief(total)} {word}" for word, total in sums.items() if total)


def _brief(number: int) -> str:
    """Returns a number in at most four characters: at 80 columns there is no room for more."""
    for unit, name in ((10**9, "G"), (10**6, "M"), (10**3, "k")):
        if number >= 0.9995 * unit:  # 999,500 is 1.0M, not 1000k
            brief = number / unit
            return f"{brief:.{1 if brief < 9.95 else 0}f}{name}"
    return str(number)


def one_line(text: str) -> str:
    """Returns ``text`` without line ends and control characters, which would break the screen."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


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
