"""`needs`: what 10, 100 and 1,000 robots in real time need, computed from measurements.

Each row says which of its numbers were measured, in which file, and which are computed from them.
"""

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.many_actors import STEPS_PER_SECOND, WEIGHTS_BYTES
from benchmarks.report import cell
from common.errors import InputError
from common.run.config import LearningConfig
from common.run.presets import PRESETS
from common.transport.access_control import MOST_SESSIONS

ROBOTS = (10, 100, 1_000)
NAMES = (
    "what",
    *(f"{robots:,} robots" for robots in ROBOTS),
    "how it is known",
    "saturates (computed)",
)
_GIGABIT = 125e6
"""Bytes per second of a network of 1 Gbit/s."""
_FOR_WEIGHTS = 100e6
"""Bytes per second that weights may take."""
_PAPER: LearningConfig = PRESETS["paper"].learning
SOURCES = ("actor_steps", "many_actors", "peers", "transport")
"""Names of the results from which it is computed."""


def needs(folder: Path) -> Iterator[list[str]]:
    """Yields a row for each resource that robots need, with columns `NAMES`.

    Raises:
        InputError: a result does not exist, or lacks a figure.
    """
    try:
        texts = {name: (folder / f"{name}.json").read_bytes() for name in SOURCES}
        yield from _rows({name: json.loads(text) for name, text in texts.items()})
    except (OSError, ValueError, KeyError) as error:
        names = ", ".join(f"{name}.json" for name in SOURCES)
        raise InputError(f"{folder} needs {names} ({error!r}): run `make bench`.") from None


def _rows(found: Mapping[str, Any]) -> Iterator[list[str]]:
    # Agent steps per second of a robot's actor on one core, updates per second of a learner on two.
    actor: float = found["actor_steps"]["robot"]["1"]
    updates: float = max(
        each["ours/s"]
        for each in found["peers"]["rows"]
        if each["work"].startswith(f"updates of {_PAPER.batch_size},")
    )
    insert, sample = found["transport"]["insert"], found["transport"]["sample"]
    # Steps per second that a replay accepts while it serves minibatches over Zenoh.
    inserts: float = found["transport"]["insert_at_once"]["transitions_per_second"]
    step_bytes = insert["megabytes_per_second"] * 1e6 / insert["transitions_per_second"]
    batch_bytes = sample["megabytes_per_second"] * 1e6 / sample["calls_per_second"]

    def row(what: str, values: NDArray[np.float64], how: str, limit: str = "") -> list[str]:
        return [what, *map(cell, values.tolist()), how, limit]

    def at(robots: float) -> str:
        return f"at {robots:,.0f} robots"

    robots = np.array(ROBOTS, np.float64)
    # For each number of robots, the hub that was measured with the nearest number of actors.
    hubs: list[Mapping[str, Any]] = [
        min(found["many_actors"]["many_actors"], key=lambda hub: abs(math.log(hub["actors"] / n)))
        for n in ROBOTS
    ]
    steps = robots * STEPS_PER_SECOND
    due = steps / _PAPER.train_period
    made = np.minimum(due, updates)
    weights = made / _PAPER.publish_period * WEIGHTS_BYTES * robots
    # More robots mean more updates, up to the learner's limit, and all robots get the weights.
    pace = _GIGABIT * _PAPER.publish_period / WEIGHTS_BYTES
    full = max(math.sqrt(pace * _PAPER.train_period / STEPS_PER_SECOND), pace / updates)
    measured = "measured with " + ", ".join(f"{hub['actors']:,}" for hub in hubs) + " actors"
    most, gigabit = hubs[-1], "1 Gbit/s"
    yield row("agent steps/s", steps, f"{STEPS_PER_SECOND} of each")
    yield row(
        "cores for actors",
        steps / actor,
        f"computed: one core plays {actor:.0f} steps/s",
        f"a core {at(actor / STEPS_PER_SECOND)}",
    )
    yield row(
        "cores for the hub",
        np.array([hub["hub_cores"] / hub["actors"] for hub in hubs]) * robots,
        f"{measured}; scaled to the number",
        f"a core {at(most['actors'] / most['hub_cores'])}; connections at {MOST_SESSIONS:,}",
    )
    yield row(
        "MB of the hub for connections",
        np.array([hub["hub_bytes_per_actor"] for hub in hubs]) * robots / 1e6,
        f"{measured}; scaled to the number",
    )
    p99 = np.array([hub["p99_ms"] for hub in hubs])
    yield row("p99 ms until a chunk is acknowledged", p99, measured)
    yield row(
        "share of what the replay takes",
        steps / inserts,
        f"computed: it took {inserts:,.0f} steps/s beside draws over Zenoh",
        at(inserts / STEPS_PER_SECOND),
    )
    yield row(
        "MB/s of chunks",
        steps * step_bytes / 1e6,
        f"computed: {step_bytes / 1e3:.1f} kB a step",
        f"{gigabit} {at(_GIGABIT / step_bytes / STEPS_PER_SECOND)}",
    )
    yield row(
        f"updates/s, one per {_PAPER.train_period} steps",
        due,
        "computed",
        f"two cores {at(updates * _PAPER.train_period / STEPS_PER_SECOND)}",
    )
    yield row(
        "learners of two cores that it would take",
        due / updates,
        f"computed: two cores make {updates:.0f} updates/s; there is one learner",
    )
    yield row(
        "`--learning.train-period` that one such learner keeps up with",
        np.maximum(_PAPER.train_period, np.ceil(steps / updates)),
        "computed",
    )
    yield row(
        "MB/s of minibatches, if replay and learner are on two machines",
        made * batch_bytes / 1e6,
        f"computed: {batch_bytes / 1e6:.1f} MB each, at most {updates:.0f}/s",
        f"{gigabit} at {_GIGABIT / batch_bytes:.0f} updates/s",
    )
    yield row(
        f"MB/s of weights, each {_PAPER.publish_period} updates",
        weights / 1e6,
        f"computed: {WEIGHTS_BYTES / 1e6:.1f} MB to each robot's process; measured: "
        f"{most['weights_arrived']:,} of {most['actors']:,} actors had one in "
        f"{most['weights_seconds']:.1f} s",
        f"{gigabit} {at(full)}",
    )
    period = np.ceil(_PAPER.publish_period * weights / _FOR_WEIGHTS)
    yield row(
        f"`--learning.publish-period` for {_FOR_WEIGHTS / 1e6:.0f} MB/s of them",
        np.maximum(_PAPER.publish_period, period),
        "computed",
    )
