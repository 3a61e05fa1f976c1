"""What the page shows of a snapshot, as texts and numbers of JSON's types."""

import re
from typing import Any

from common.metrics import METRICS, Metric, Value, Values, number
from common.protocol.actor_stats import TOTALS
from common.registry import ENVIRONMENTS
from common.strict_json import strict
from learner.telemetry import formats
from learner.telemetry.panels import (
    ProgressBar,
    label_and_text,
    panels_of,
    progress_of,
    short_label,
    troubles,
)
from learner.telemetry.snapshot import ActorView, Snapshot

_UNSAID = ("none", "ratio", "per second")


def about(metric: Metric) -> dict[str, str]:
    """Returns name, meaning, unit and form of a curve."""
    if metric.bound:
        label = metric.bound.check.removesuffix(" ms")
    elif metric.label and metric.shown.count("{") < 2:  # "press p50/99" names two figures
        label = short_label(metric)
    else:
        label = re.sub("[/_]", " ", metric.gate.removesuffix("_ms") or metric.key)
    return {
        "label": label,
        "meaning": metric.meaning,
        "unit": "" if metric.unit in _UNSAID or metric.unit in label else metric.unit,
        "form": metric.form,
    }


def figures(snapshot: Snapshot) -> dict[str, Any]:
    """Returns all that the page shows, except curves and pictures."""
    values = snapshot.values
    env = ENVIRONMENTS.find(str(values["run/env"]))
    return {
        "run": {
            "name": values["run/run"],
            "env": env.title or env.name,
            "game": formats.game_of(values),
            **{key: values[f"run/{key}"] for key in ("preset", "phase")},
            "device": formats.hardware(values),
            "join": values.get("run/join"),
            "robot": env.robot,
        },
        "progress": [_progress(each, values) for each in progress_of(values)],
        "panels": {
            title: [_row(metric, values) for metric in metrics]
            for title, metrics in panels_of(values).items()
        },
        "verdict": snapshot.verdict,
        "checks": [
            check._asdict() | {"value": formats.reading(check)} for check in snapshot.checks
        ],
        "alive": [values["stream/actors_alive"], values["stream/actors_present"]],
        "troubles": troubles(values).lstrip(", "),
        "actors": [_actor(actor, values) for actor in snapshot.present],
        "random": strict(number(values, "play/random_reward")),
    }


def _progress(progress: ProgressBar, values: Values) -> dict[str, Any]:
    done, total = (number(values, key) for key in (progress.done, progress.total))
    told = formats.figure(progress.done, values)
    told += (
        f" of {formats.figure(progress.total, values)} steps" if total else " steps, until stopped"
    )
    return {
        "label": progress.label,
        "share": min((done or 0) / total, 1.0) if total else None,
        "text": told,
        "note": progress.note,
        "meaning": METRICS[progress.done].meaning,
    }


def _row(metric: Metric, values: Values) -> dict[str, str]:
    label, text = label_and_text(metric, values)
    return {"label": label, "text": text, "meaning": metric.meaning}


def _actor(actor: ActorView, values: Values) -> dict[str, Any]:
    stats = actor.stats
    newest = number(values, "stream/weights_version") or 0
    totals: dict[str, Value] = {key: getattr(stats, name) for name, key in TOTALS.items()}
    tests = stats.role == "evaluator"
    gone = "" if actor.alive else formats.ended(stats.leaving)
    return {
        "name": stats.name,
        "role": stats.role,
        "gone": gone,
        "machine": stats.machine or formats.UNKNOWN,
        "age": formats.duration(stats.seconds),
        "steps": f"{stats.steps:,}",
        "rate": gone or formats.decimal(stats.steps_per_second, 1),
        "epsilon": formats.decimal(stats.epsilon, 3),
        "weights": (
            f"epoch {stats.weights_version}"
            if tests
            else f"{max(newest - stats.weights_version, 0):,.0f}"
        ),
        "throttled": formats.share(stats.throttled_share, 1),
        "cores": formats.cores(stats.busy_cores).removesuffix(" CPU"),
        "memory": formats.size(stats.memory_bytes),
        "silent": f"{actor.silent_for:.0f} s",
        "trouble": troubles(totals).lstrip(", "),
    }
