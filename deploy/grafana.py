"""`python -m deploy.grafana`: writes deploy/grafana/dashboard.json, with every figure of a run.

Figures, units and descriptions come from `common.metrics`; those of each actor come from
`learner.telemetry.sinks.prometheus`. This module chooses what a person sees first. Every other
figure has a panel in the collapsed row of its group, so that none can be forgotten.
"""

import json
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from common.exposition import exposed_name
from common.metrics import METRICS, Metric
from learner.telemetry.sinks.prometheus import CHECK, OMITTED, PER_ACTOR

DASHBOARD = Path(__file__).with_name("grafana") / "dashboard.json"
_FIRST: dict[str, tuple[str, ...]] = {
    "Score": tuple(f"play/{of}_reward" for of in ("train", "test", "best_test", "random")),
    "Mean max-Q": ("learning/mean_max_q",),
    "Loss": ("learning/loss",),
    "Agent steps per second": ("run/agent_steps",),
    "Updates per second": ("learning/updates",),
    "Staleness of the weights": ("stream/staleness_p50", "stream/staleness_p95"),
    "Samples per insert": ("stream/samples_per_insert", "stream/samples_per_insert_goal"),
    "Chunks per second": tuple(
        f"stream/chunks_{what}" for what in ("acked", "retried", "duplicate", "refused")
    ),
    "Steps in the replay": ("stream/stored", "stream/samplable", "stream/capacity"),
    "Actors": tuple(f"stream/actors_{which}" for which in ("alive", "present", "starting")),
    "Hands: time until the commanded keys are down": ("hands/press_p50", "hands/press_p99"),
    "Sight and touch": ("play/valid_frame_share", "play/press_match_share"),
    "Memory and files": ("run/memory_bytes", "replay/private_bytes", "replay/file_bytes"),
}
"""Figures of the panels that are shown first, by the panels' titles."""
_FIRST_OF_ACTORS = ("actor/steps_per_second", "actor/throttled_share")
OF_LEARNER = '{job="ale-robot-learner",instance="$learner"}'
"""Selector of the series of the learner that a person has chosen."""
_LEARNERS = 'label_values(up{job="ale-robot-learner"}, instance)'
_SOURCE = {"type": "prometheus", "uid": "${source}"}
_ACROSS, _WIDTH, _HEIGHT = 3, 8, 8
"""Panels side by side, and the size of each; a dashboard is 24 units wide."""
_UNITS = {"bytes": "bytes", "milliseconds": "s", "seconds": "s", "per second": "ops"}
"""Grafana's names of the units that it formats in a special way."""


def _unit(metric: Metric) -> str:
    """Returns Grafana's name of the unit of a figure in Prometheus, or of its rate."""
    if metric.counter:
        return "ops"
    if metric.unit == "ratio" and metric.meaning.startswith("Share "):
        return "percentunit"
    return _UNITS.get(metric.unit, "short")


def _name(metric: Metric) -> str:
    return metric.key.partition("/")[2].replace("_", " ")


def _panel(title: str, metrics: Sequence[Metric], legend: str = "") -> dict[str, Any]:
    """Returns a panel of figures with the same unit; ``legend`` is that of a series, the figure's
    name if it is empty."""
    (unit,) = {_unit(metric) for metric in metrics}
    series = [(metric, exposed_name(metric) + OF_LEARNER) for metric in metrics]
    return {
        "type": "state-timeline" if metrics[0] is CHECK else "timeseries",
        "title": title,
        "description": "\n\n".join(f"{_name(metric)}: {metric.meaning}." for metric in metrics),
        "datasource": _SOURCE,
        "fieldConfig": {"defaults": {"unit": unit}, "overrides": []},
        "targets": [
            {
                "refId": f"F{n}",
                "expr": f"rate({name}[1m])" if metric.counter else name,
                "legendFormat": legend or _name(metric),
            }
            for n, (metric, name) in enumerate(series)
        ],
    }


def _of_actor(metric: Metric) -> dict[str, Any]:
    title = f"{_name(metric)}, by actor".capitalize()
    return _panel(title, [metric], "{{actor}}")


def _others() -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yields each group of the table, with panels of its figures that are not shown first.

    Figures of one unit share a panel. Figures without a unit have one each, as their scales differ.
    """
    shown = {key for keys in _FIRST.values() for key in keys}
    found = [m for m in METRICS.values() if m.form != "text" and m.key not in shown]

    def group(metric: Metric) -> str:
        return metric.key.partition("/")[0]

    def alike(metric: Metric) -> tuple[str, str, str]:
        return _unit(metric), metric.unit, metric.key if metric.unit == "none" else ""

    for name, of_group in groupby(sorted(found, key=group), group):
        panels = []
        for (of, unit, key), metrics in groupby(sorted(of_group, key=alike), alike):
            each = list(metrics)
            what = "shares" if of == "percentunit" else unit
            what = _name(each[0]) if key else what + (" (rates)" if each[0].counter else "")
            panels.append(_panel(f"{name}: {what}".capitalize(), each))
        yield name, panels


def _placed(panels: Iterable[dict[str, Any]], top: int) -> list[dict[str, Any]]:
    return [
        panel
        | {
            "gridPos": {
                "x": n % _ACROSS * _WIDTH,
                "y": top + n // _ACROSS * _HEIGHT,
                "w": _WIDTH,
                "h": _HEIGHT,
            }
        }
        for n, panel in enumerate(panels)
    ]


def dashboard() -> dict[str, Any]:
    """Returns the dashboard in the form that Grafana imports."""
    of_actors = {metric.key: _of_actor(metric) for metric in PER_ACTOR}
    first = [
        *(_panel(title, [METRICS[key] for key in keys]) for title, keys in _FIRST.items()),
        _panel("Red health checks", [CHECK], "{{check}}"),
        *(of_actors.pop(key) for key in _FIRST_OF_ACTORS),
    ]
    rows = [
        *_others(),
        ("each actor", [*of_actors.values(), _panel("Actors left out", [OMITTED], "actors")]),
    ]
    panels = _placed(first, 0)
    top = -(-len(first) // _ACROSS) * _HEIGHT
    for n, (group, inside) in enumerate(rows, top):
        panels.append(
            {
                "type": "row",
                "title": f"More: {group}",
                "collapsed": True,
                "gridPos": {"x": 0, "y": n, "w": 24, "h": 1},
                "panels": _placed(inside, n + 1),
            }
        )
    for n, panel in enumerate(flat(panels), 1):
        panel["id"] = n
    return {
        "title": "ALE-Robot",
        "uid": "ale-robot",
        "schemaVersion": 38,
        "version": 1,
        "editable": True,
        "tags": ["ale-robot"],
        "refresh": "10s",
        "annotations": {"list": []},
        "time": {"from": "now-3h", "to": "now"},
        "templating": {
            "list": [
                {
                    "name": "source",
                    "label": "Prometheus",
                    "type": "datasource",
                    "query": "prometheus",
                },
                {
                    "name": "learner",
                    "label": "Learner",
                    "description": "Address of the learner whose run is shown.",
                    "type": "query",
                    "datasource": _SOURCE,
                    "query": {"query": _LEARNERS, "refId": "learner"},
                    "refresh": 2,  # whenever the range of time changes
                    "sort": 1,
                },
            ]
        },
        "panels": panels,
    }


def flat(panels: Iterable[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yields all panels: the rows, and the panels in them."""
    for panel in panels:
        yield panel
        yield from panel.get("panels", ())


def text() -> str:
    """Returns the content of the dashboard's file."""
    return json.dumps(dashboard(), indent=1) + "\n"


if __name__ == "__main__":
    DASHBOARD.write_text(text(), encoding="utf-8")
    print(f"wrote {DASHBOARD}")
