"""Who takes part: what actors and evaluators say of themselves, and whether they live."""

import math
import threading
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, cast

from common.errors import MessageError
from common.metrics import Value
from common.protocol.actor_stats import TOTALS, ActorStats, Role
from common.protocol.run_keys import RunKeys
from common.transport.interface import Envelope, Transport
from learner.telemetry.snapshot import ActorView
from replay.chunk_statistics import ChunkStatistics

_LAST_WORDS = 1.0
"""Seconds in which the counters of a process that leaves may come after its token has gone."""
LEFT_SHOWN = 10.0
"""Seconds for which an actor that left stays on the display."""
_SETTLED = 60.0
"""Seconds after which nothing more is expected of a process that has gone: its last counters and
chunks are there."""
_LONGEST_DELAY = 5.0
"""Maximum number of seconds that a heartbeat is on its way."""
_MOST_GONE = 256
"""Processes that are kept by name after they have gone; the rest is kept as totals."""
_MOST_FOLDED = 4_096
_KNOWN = {each.name for each in fields(ActorStats)}


@dataclass
class _Process:
    """One start of an actor or evaluator."""

    stats: ActorStats
    accepted: int = 0
    """Its chunks that the replay has stored."""
    heard: float = field(default_factory=lambda: time.monotonic())
    """Monotonic seconds at which a heartbeat, a chunk or a checkpoint last told of it."""
    known: int = 0
    """Accepted chunks that are so old that its counters must include them."""
    marked: tuple[float, int] = (-math.inf, 0)
    """A while ago, and the accepted chunks by then."""

    def hear(self, stats: ActorStats, now: float) -> None:
        """Take in a heartbeat."""
        self.stats, self.heard = stats, now
        if now - self.marked[0] >= _LONGEST_DELAY:
            self.known, self.marked = self.marked[1], (now, self.accepted)

    @property
    def made(self) -> int:
        """Chunks that it made. One that never said goodbye may have made more than it told."""
        stored = self.accepted + self.stats.refused
        return self.stats.made if self.stats.leaving else max(self.stats.made, stored)

    @property
    def excess(self) -> int:
        """Chunks stored beyond those that it says it made."""
        stored = self.accepted if self.stats.leaving else self.known
        return max(stored + self.stats.refused - self.stats.made, 0)

    @property
    def totals(self) -> ActorStats:
        """What it adds to the run's totals."""
        return replace(self.stats, made=self.made)


class ActorRegistry:
    """Listens to heartbeats and liveliness tokens; safe to ask from any thread."""

    def __init__(self, transport: Transport, keys: RunKeys) -> None:
        self._lock = threading.Lock()
        self._processes: dict[int, _Process] = {}
        """By incarnation; of those that have gone, the latest `_MOST_GONE`."""
        self._gone: dict[Role, ActorStats] = {}
        """Totals of all others."""
        self._gone_excess = 0
        self._folded: dict[int, bool] = {}
        """Incarnations that are in these totals, and whether they said goodbye."""
        self._newest: dict[str, int] = {}
        """Incarnation by role and name."""
        self._alive: dict[str, bool] = {}
        self._heard: dict[str, float] = {}
        self._notes: list[str] = []
        self._lost: dict[str, float] = {}
        self._subscriptions = (
            transport.subscribe(keys.stats("*", "*"), self._on_stats),
            transport.watch_presence(keys.live("*", "*"), self._on_presence),
        )

    def restore(self, state: Any) -> None:
        """Remember the processes of a checkpoint, so that counts go on from there."""
        if isinstance(state, list):  # from before totals were kept
            state = {"processes": state, "gone": [], "excess": 0, "folded": []}
        with self._lock:
            for each in state["processes"]:
                stats = _stats_from(each)
                # One that goes on may have been heard already, of which its chunks know nothing.
                process = self._processes.setdefault(stats.incarnation, _Process(stats))
                process.accepted = each.get("accepted", 0)
            self._gone = {stats.role: stats for stats in map(_stats_from, state["gone"])}
            self._gone_excess = state["excess"]
            self._folded = dict(state["folded"])

    def state(self) -> dict[str, Any]:
        """All processes there ever were, of JSON's types."""
        with self._lock:
            return {
                "processes": [
                    {**asdict(process.stats), "accepted": process.accepted}
                    for process in self._processes.values()
                ],
                "gone": [asdict(stats) for stats in self._gone.values()],
                "excess": self._gone_excess,
                "folded": list(self._folded.items()),
            }

    def accepted(self, chunk: ChunkStatistics) -> None:
        """Credit its actor with a chunk that the replay has stored; once for each."""
        with self._lock:
            if chunk.incarnation in self._folded:
                if self._folded[chunk.incarnation]:
                    self._gone_excess += 1
                else:
                    self._gone_as("actor").made += 1
            elif chunk.incarnation:
                unheard = _Process(ActorStats(chunk.actor, "actor", chunk.incarnation))
                process = self._processes.setdefault(chunk.incarnation, unheard)
                process.accepted += 1
                process.heard = time.monotonic()

    def take_notes(self) -> list[str]:
        """Arrivals and losses since the last call, as sentences."""
        now = time.monotonic()
        with self._lock:
            for key, since in list(self._lost.items()):
                if now - since > _LAST_WORDS:
                    del self._lost[key]
                    process = self._processes.get(self._newest.get(key, -1))
                    left = process is not None and process.stats.leaving
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

    def values(self) -> dict[str, Value]:
        """Returns totals over all processes there ever were."""
        with self._lock:
            self._fold(time.monotonic())
            processes = list(self._processes.values())
            every = [*(process.totals for process in processes), *self._gone.values()]
            excess = self._gone_excess + sum(process.excess for process in processes)
        totals = {key: sum(getattr(each, name) for each in every) for name, key in TOTALS.items()}
        steps = totals[TOTALS["steps"]]
        elapsed_per_step = totals[TOTALS["decisions"]] / steps if steps else None
        return {
            **totals,
            "stream/chunks_excess": excess,
            "actors/elapsed_per_step": elapsed_per_step,
        }

    def key_times(self) -> tuple[int, ...]:
        """How long the hands took (`common.press_latency`), over all processes there ever were."""
        with self._lock:
            every = [*(each.stats for each in self._processes.values()), *self._gone.values()]
        return _sums(stats.key_times for stats in every)

    def actors(self) -> tuple[ActorView, ...]:
        """All that were here since this learner began, the newest process of each name."""
        now = time.monotonic()
        with self._lock:
            found = []
            for key, alive in sorted(self._alive.items()):
                role, name = key.split("/")
                if role not in ("actor", "evaluator"):
                    continue
                process = self._processes.get(self._newest.get(key, -1))
                stats = process.stats if process else ActorStats(name, cast(Role, role))
                silent = now - self._heard.get(key, now)
                if not alive:
                    stats = replace(stats, steps_per_second=0.0, held_share=0.0)
                left = not alive and (process is None or stats.leaving) and silent > LEFT_SHOWN
                found.append(ActorView(stats=stats, alive=alive, silent_for=silent, left=left))
            return tuple(found)

    def _fold(self, now: float) -> None:
        """Add to the totals what has gone: at once if another process has its name, and the oldest
        where too many are kept."""
        gone = []
        for incarnation, process in self._processes.items():
            key = f"{process.stats.role}/{process.stats.name}"
            replaced = self._newest.get(key, incarnation) != incarnation
            if now - process.heard > _SETTLED and (replaced or not self._alive.get(key)):
                gone.append((not replaced, process.heard, incarnation, key))
        gone.sort()
        replaced_ones = sum(not by_name for by_name, *_ in gone)
        for _, _, incarnation, key in gone[: max(replaced_ones, len(gone) - _MOST_GONE)]:
            process = self._processes.pop(incarnation)
            stats = process.totals
            total = self._gone_as(stats.role)
            for name in TOTALS:
                setattr(total, name, getattr(total, name) + getattr(stats, name))
            total.key_times = _sums((total.key_times, stats.key_times))
            self._gone_excess += process.excess
            self._folded[incarnation] = stats.leaving
            if self._newest.get(key) == incarnation:
                for by_name in (self._newest, self._alive, self._heard):
                    by_name.pop(key, None)
        for incarnation in list(self._folded)[:-_MOST_FOLDED]:
            del self._folded[incarnation]

    def _gone_as(self, role: Role) -> ActorStats:
        return self._gone.setdefault(role, ActorStats("gone", role))

    def _on_stats(self, message: Envelope) -> None:
        try:
            stats = ActorStats.decode(message.payload)
        except MessageError:
            return  # somebody else's noise on our key
        key = f"{stats.role}/{stats.name}"
        if not message.key.endswith("/" + key):
            return
        now = time.monotonic()
        with self._lock:
            if stats.incarnation not in self._folded:
                self._processes.setdefault(stats.incarnation, _Process(stats)).hear(stats, now)
                self._newest[key] = stats.incarnation
                self._heard[key] = now

    def _on_presence(self, key: str, alive: bool) -> None:
        key = "/".join(key.split("/")[-2:])
        now = time.monotonic()
        with self._lock:
            before = self._alive.get(key)
            self._alive[key] = alive
            self._heard[key] = now
            if alive and before is not True:
                self._lost.pop(key, None)
                self._notes.append(f"{_name(key)} joined")
            elif not alive:
                self._lost[key] = now


def _name(key: str) -> str:
    return key.split("/")[1]


def _stats_from(state: dict[str, Any]) -> ActorStats:
    """Counters of a checkpoint, which may lack some or have others."""
    known = {name: value for name, value in state.items() if name in _KNOWN}
    return ActorStats(**{**known, "key_times": tuple(known.get("key_times", ()))})


def _sums(counts: Iterable[tuple[int, ...]]) -> tuple[int, ...]:
    """Sums place by place, of those that are there."""
    return tuple(map(sum, zip(*filter(None, counts), strict=True)))
