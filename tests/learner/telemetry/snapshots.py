"""Snapshots of a run for tests to which only some figures matter."""

from dataclasses import replace
from typing import Any

from common.metrics import METRICS, Value
from learner.telemetry.snapshot import Snapshot

PLAIN: dict[str, Value] = {
    "run/run": "pong-1",
    "run/preset": "fast",
    "run/env": "ale",
    "run/game": "pong",
    "run/device": "cpu",
    "run/phase": "warm-up",
    "run/seconds": 0.0,
    "run/agent_steps": 0,
    "run/epoch": 0,
    "run/phase_steps": 0,
    "run/phase_length": 10_000,
    "stream/samples_per_insert_goal": 8.0,
    "stream/stored": 0,
    "stream/capacity": 200_000,
    "stream/actors_alive": 0,
    "stream/actors_present": 0,
    **{f"stream/chunks_{name}": 0 for name in ("made", "acked", "retried", "duplicate", "refused")},
    "gates/failed": 0,
}
"""Figures of a run that has just begun."""


def snapshot(values: dict[str, Value], **others: Any) -> Snapshot:
    """A run that has just begun, but for these ``values`` by their keys."""
    assert values.keys() <= METRICS.keys()
    return Snapshot(values={**PLAIN, **values}, **others)


def changed(snapshot: Snapshot, values: dict[str, Value], **others: Any) -> Snapshot:
    """``snapshot`` with other ``values``."""
    assert values.keys() <= METRICS.keys()
    return replace(snapshot, values={**snapshot.values, **values}, **others)
