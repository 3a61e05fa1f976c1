"""Who takes part: what actors and evaluators say of themselves, and whether they live."""

import threading
import time
from dataclasses import asdict, fields
from typing import Any

from common.errors import MessageError
from common.protocol.actor_stats import ActorStats
from common.protocol.run_keys import RunKeys
from common.transport.interface import Envelope, Transport
from learner.telemetry.status import ActorStatus, TimeCounts

_LAST_WORDS = 1.0
"""Seconds in which the counters of a process that leaves may come after its token has gone."""
LEFT_SHOWN = 10.0
"""Seconds that an actor which took its leave stays on the display."""


class ActorRegistry:
    """Listens to heartbeats and liveliness tokens; safe to ask from any thread."""

    def __init__(self, transport: Transport, keys: RunKeys) -> None:
        self._lock = threading.Lock()
        self._stats: dict[int, ActorStats] = {}  # by incarnation: every process there ever was
        self._heard: dict[str, float] = {}
        self._newest: dict[str, int] = {}
        self._alive: dict[str, bool] = {}
        self._notes: list[str] = []
        self._gone: dict[str, float] = {}
        self._subscriptions = (
            transport.subscribe(keys.stats("*", "*"), self._on_stats),
            transport.watch_presence(keys.live("*", "*"), self._on_presence),
        )

    def restore(self, state: list[dict[str, Any]]) -> None:
        """Remember the processes of a checkpoint, so that counts go on from there."""
        with self._lock:
            for each in state:
                stats = ActorStats(**{**each, "key_times": tuple(each.get("key_times", ()))})
                self._stats.setdefault(stats.incarnation, stats)

    def state(self) -> list[dict[str, Any]]:
        """All processes there ever were, of JSON's types."""
        with self._lock:
            return [asdict(stats) for stats in self._stats.values()]

    def take_notes(self) -> list[str]:
        """Arrivals and losses since the last call, as sentences."""
        now = time.monotonic()
        with self._lock:
            for key, since in list(self._gone.items()):
                if now - since > _LAST_WORDS:
                    del self._gone[key]
                    stats = self._stats.get(self._newest.get(key, -1))
                    left = stats is not None and stats.leaving
                    self._notes.append(f"{_name(key)} {'left' if left else 'was lost'}")
            notes, self._notes = self._notes, []
        return notes

    def alive(self, role: str) -> set[str]:
        """Names of the living."""
        with self._lock:
            return {
                _name(key)
                for key, alive in self._alive.items()
                if alive and key.startswith(role + "/")
            }

    def counts(self) -> tuple[int, int]:
        """Chunks made and sent again, over all processes there ever were."""
        with self._lock:
            every = list(self._stats.values())
        return sum(s.made for s in every), sum(s.retried for s in every)

    def time(self) -> TimeCounts:
        """How time went, over all processes there ever were."""
        with self._lock:
            every = list(self._stats.values())
        names = [each.name for each in fields(TimeCounts)]
        return TimeCounts(**{name: sum(getattr(s, name) for s in every) for name in names})

    def key_times(self) -> tuple[int, ...]:
        """How long the hands took (`common.press_latency`), over all processes there ever were."""
        with self._lock:
            told = [stats.key_times for stats in self._stats.values() if stats.key_times]
        return tuple(map(sum, zip(*told, strict=True)))

    def actors(self) -> tuple[ActorStatus, ...]:
        """All that were here since this learner began, the newest process of each name."""
        now = time.monotonic()
        with self._lock:
            found = []
            for key, alive in sorted(self._alive.items()):
                stats = self._stats.get(self._newest.get(key, -1))
                silent = now - self._heard.get(key, now)
                role, name = key.split("/")
                if role not in ("actor", "evaluator"):
                    continue
                leaves = not alive and (stats is None or stats.leaving)
                left = leaves and silent > LEFT_SHOWN
                found.append(_status(name, role, alive, left, silent, stats))
            return tuple(found)

    def _on_stats(self, message: Envelope) -> None:
        try:
            stats = ActorStats.decode(message.payload)
        except MessageError:
            return  # somebody else's noise on our key
        key = f"{stats.role}/{stats.name}"
        if not message.key.endswith("/" + key):
            return
        with self._lock:
            self._stats[stats.incarnation] = stats
            self._newest[key] = stats.incarnation
            self._heard[key] = time.monotonic()

    def _on_presence(self, key: str, alive: bool) -> None:
        key = "/".join(key.split("/")[-2:])
        with self._lock:
            before = self._alive.get(key)
            self._alive[key] = alive
            self._heard[key] = time.monotonic()
            if alive and before is not True:
                self._gone.pop(key, None)
                self._notes.append(f"{_name(key)} joined")
            elif not alive:
                self._gone[key] = time.monotonic()


def _name(key: str) -> str:
    return key.split("/")[1]


def _status(
    name: str, role: Any, alive: bool, left: bool, silent: float, stats: ActorStats | None
) -> ActorStatus:
    if stats is None:
        return ActorStatus(name=name, role=role, alive=alive, silent_for=silent, left=left)
    return ActorStatus(
        name=name,
        role=role,
        alive=alive,
        steps=stats.steps,
        steps_per_second=stats.steps_per_second if alive else 0.0,
        epsilon=stats.epsilon,
        weights_version=stats.weights_version,
        made=stats.made,
        acked=stats.acked,
        retried=stats.retried,
        refused=stats.refused,
        held_share=stats.held_share if alive else 0.0,
        valid_share=stats.valid_share,
        match_share=stats.match_share,
        decisions=stats.decisions,
        missed_deadlines=stats.missed_deadlines,
        late_frames=stats.late_frames,
        waits_given_up=stats.waits_given_up,
        silent_for=silent,
        left=left,
    )
