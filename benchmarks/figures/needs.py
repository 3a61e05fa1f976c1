"""`needs`: what 10, 100 and 1,000 robots in real time need, computed from measurements.

Each row says which of its numbers were measured, in which file, and which are computed from them.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.many_actors import STEPS_PER_SECOND, WEIGHTS_BYTES
from benchmarks.report import cell
from common.errors import InputError
from common.settings.config import LearningConfig
from common.settings.presets import PRESETS
from common.transport.access_control import MAX_SESSIONS

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
_ROBOTS = np.array(ROBOTS, np.float64)
_STEPS = _ROBOTS * STEPS_PER_SECOND
"""Agent steps per second of so many robots."""
_DUE = _STEPS / _PAPER.train_period
"""Updates per second that are due for so many steps."""
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
    # Updates per second of a learner on two cores.
    updates = max(
        each["ours/s"]
        for each in found["peers"]["rows"]
        if each["work"].startswith(f"updates of {_PAPER.batch_size},")
    )
    # For each number of robots, the hub that was measured with the nearest number of actors.
    hubs: list[Mapping[str, Any]] = [
        min(found["many_actors"]["many_actors"], key=lambda hub: abs(math.log(hub["actors"] / n)))
        for n in ROBOTS
    ]
    yield from _of_actors(found["actor_steps"]["robot"]["1"])
    yield from _of_hub(hubs)
    yield from _of_replay(found["transport"])
    yield from _of_learner(updates, found["transport"]["sample"])
    yield from _of_weights(updates, hubs[-1])


def _of_actors(actor: float) -> Iterator[list[str]]:
    """Yields the rows of acting; a robot's ``actor`` plays so many steps per second on a core."""
    yield _row("agent steps/s", _STEPS, f"{STEPS_PER_SECOND} of each")
    yield _row(
        "cores for actors",
        _STEPS / actor,
        f"computed: one core plays {actor:.0f} steps/s",
        f"a core {_at(actor / STEPS_PER_SECOND)}",
    )


def _of_hub(hubs: Sequence[Mapping[str, Any]]) -> Iterator[list[str]]:
    """Yields the rows of connections, from one measured hub for each of `ROBOTS`."""
    measured = "measured with " + ", ".join(f"{hub['actors']:,}" for hub in hubs) + " actors"
    most = hubs[-1]
    yield _row(
        "cores for the hub",
        np.array([hub["hub_cores"] / hub["actors"] for hub in hubs]) * _ROBOTS,
        f"{measured}; scaled to the number",
        f"a core {_at(most['actors'] / most['hub_cores'])}; connections at {MAX_SESSIONS:,}",
    )
    yield _row(
        "MB of the hub for connections",
        np.array([hub["hub_bytes_per_actor"] for hub in hubs]) * _ROBOTS / 1e6,
        f"{measured}; scaled to the number",
    )
    p99 = np.array([hub["p99_ms"] for hub in hubs])
    yield _row("p99 ms until a chunk is acknowledged", p99, measured)


def _of_replay(transport: Mapping[str, Any]) -> Iterator[list[str]]:
    """Yields the rows of the steps that the replay takes."""
    # Steps per second that it accepts while it serves minibatches over Zenoh.
    inserts: float = transport["insert_at_once"]["transitions_per_second"]
    insert = transport["insert"]
    step_bytes = insert["megabytes_per_second"] * 1e6 / insert["transitions_per_second"]
    yield _row(
        "share of what the replay takes",
        _STEPS / inserts,
        f"computed: it took {inserts:,.0f} steps/s beside draws over Zenoh",
        _at(inserts / STEPS_PER_SECOND),
    )
    yield _row(
        "MB/s of chunks",
        _STEPS * step_bytes / 1e6,
        f"computed: {step_bytes / 1e3:.2f} kB a step",
        f"1 Gbit/s {_at(_GIGABIT / step_bytes / STEPS_PER_SECOND)}",
    )


def _of_learner(updates: float, sample: Mapping[str, Any]) -> Iterator[list[str]]:
    """Yields the rows of learning, for a learner that makes so many ``updates`` per second."""
    batch_bytes = sample["megabytes_per_second"] * 1e6 / sample["calls_per_second"]
    yield _row(
        f"updates/s, one per {_PAPER.train_period} steps",
        _DUE,
        "computed",
        f"two cores {_at(updates * _PAPER.train_period / STEPS_PER_SECOND)}",
    )
    yield _row(
        "learners of two cores that it would take",
        _DUE / updates,
        f"computed: two cores make {updates:.0f} updates/s; there is one learner",
    )
    yield _row(
        "`--learning.train-period` that one such learner keeps up with",
        np.maximum(_PAPER.train_period, np.ceil(_STEPS / updates)),
        "computed",
    )
    yield _row(
        "MB/s of minibatches, if replay and learner are on two machines",
        _made(updates) * batch_bytes / 1e6,
        f"computed: {batch_bytes / 1e3:.0f} kB each, at most {updates:.0f}/s",
        f"1 Gbit/s at {_GIGABIT / batch_bytes:.0f} updates/s",
    )


def _of_weights(updates: float, hub: Mapping[str, Any]) -> Iterator[list[str]]:
    """Yields the rows of the weights that such a learner publishes to all robots."""
    weights = _made(updates) / _PAPER.publish_period * WEIGHTS_BYTES * _ROBOTS
    # More robots mean more updates, up to the learner's limit, and all robots get the weights.
    pace = _GIGABIT * _PAPER.publish_period / WEIGHTS_BYTES
    full = max(math.sqrt(pace * _PAPER.train_period / STEPS_PER_SECOND), pace / updates)
    yield _row(
        f"MB/s of weights, each {_PAPER.publish_period} updates",
        weights / 1e6,
        f"computed: {WEIGHTS_BYTES / 1e6:.1f} MB to each robot's process; measured: "
        f"{hub['weights_arrived']:,} of {hub['actors']:,} actors had one in "
        f"{hub['weights_seconds']:.1f} s",
        f"1 Gbit/s {_at(full)}",
    )
    period = np.ceil(_PAPER.publish_period * weights / _FOR_WEIGHTS)
    yield _row(
        f"`--learning.publish-period` for {_FOR_WEIGHTS / 1e6:.0f} MB/s of them",
        np.maximum(_PAPER.publish_period, period),
        "computed",
    )


def _made(updates: float) -> NDArray[np.float64]:
    """Returns the updates per second that such a learner makes of those due."""
    return np.minimum(_DUE, updates)


def _row(what: str, values: NDArray[np.float64], how: str, limit: str = "") -> list[str]:
    return [what, *map(cell, values.tolist()), how, limit]


def _at(robots: float) -> str:
    return f"at {robots:,.0f} robots"
