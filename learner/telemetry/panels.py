"""What the screen, the page and the log show of a run: its figures by panel, and its progress."""

import re
from typing import NamedTuple

from common.metrics import METRICS, Metric, Values
from common.registry import ENVIRONMENTS
from learner.telemetry.formats import fill


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
