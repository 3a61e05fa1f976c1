"""Who takes part: what actors and evaluators say of themselves, and whether they live."""

import math
import re
import threading
import time
from collections import deque
from collections.abc import Iterable
from dataclasses import asdict, astuple, dataclass, field, fields, replace
from typing import Any, cast

from common.checked import NAME
from common.errors import MessageError
from common.metrics import Value, Values
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
_MOST_KNOWN = 4_096
"""Processes, names and notes that are kept in any case, whoever sends heartbeats how often."""
_KNOWN = {each.name for each in fields(ActorStats)}


@dataclass
class _Process:
    """One start of an actor or evaluator."""

    stats: ActorStats
    accepted: int = 0
    """Its chunks that the replay has stored."""
    heard: float = field(default_factory=lambda: time.monotonic())
    """Monotonic seconds at which a heartbeat, a chunk or a checkpoint last told of it."""
    born: float = field(default_factory=lambda: time.monotonic())
    """Monotonic seconds at which it was first told of."""
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


@dataclass
class _Folded:
    """What is kept of a process that is in the totals."""

    leaving: bool
    """It said goodbye."""
    awaited: int = 0
    """Chunks that it told of and the replay has not stored; they are in the totals already."""


@dataclass
class _Name:
    """Who goes by a role and a name, and whether somebody is there."""

    newest: int = -1
    """Incarnation that was heard last; -1 for none."""
    alive: bool | None = None
    """Its liveliness token is there; None if there never was one."""
    heard: float = -math.inf
    """Monotonic seconds at which its token or a heartbeat last told of it."""
    shared: bool = False
    """Two processes go by it at once."""
    lost: float | None = None
    """Monotonic seconds at which its token went, until it is noted how it left."""


class ActorRegistry:
    """Listens to heartbeats and liveliness tokens; safe to ask from any thread."""

    def __init__(self, transport: Transport, keys: RunKeys) -> None:
        self._lock = threading.Lock()
        self._run_id = keys.run_id
        self._names: dict[tuple[str, str], _Name] = {}
        """By role and name."""
        self._processes: dict[int, _Process] = {}
        """By incarnation; of those that have gone, the latest `_MOST_GONE`."""
        self._gone = _total(())
        """Totals of all others."""
        self._gone_excess = 0
        self._folded: dict[int, _Folded] = {}
        """Those that are in these totals, by incarnation."""
        self._notes: deque[str] = deque(maxlen=_MOST_KNOWN)
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
            self._gone = _total(map(_stats_from, state["gone"]))
            self._gone_excess = state["excess"]
            self._folded = {incarnation: _Folded(*kept) for incarnation, *kept in state["folded"]}

    def state(self) -> dict[str, Any]:
        """All processes there ever were, of JSON's types."""
        with self._lock:
            self._fold(time.monotonic())
            return {
                "processes": [
                    {**asdict(process.stats), "accepted": process.accepted}
                    for process in self._processes.values()
                ],
                "gone": [asdict(self._gone)],
                "excess": self._gone_excess,
                "folded": [[key, *astuple(folded)] for key, folded in self._folded.items()],
            }

    def accepted(self, chunk: ChunkStatistics) -> None:
        """Credit its actor with a chunk that the replay has stored; once for each."""
        with self._lock:
            if folded := self._folded.get(chunk.incarnation):
                if folded.awaited:
                    folded.awaited -= 1
                elif folded.leaving:
                    self._gone_excess += 1
                else:
                    self._gone.made += 1
            elif chunk.incarnation:
                unheard = _Process(ActorStats(chunk.actor, "actor", chunk.incarnation))
                process = self._processes.setdefault(chunk.incarnation, unheard)
                process.accepted += 1
                process.heard = time.monotonic()

    def take_notes(self) -> list[str]:
        """Arrivals and losses since the last call, as sentences."""
        now = time.monotonic()
        with self._lock:
            for (_, name), known in self._names.items():
                if known.lost is not None and now - known.lost > _LAST_WORDS:
                    known.lost = None
                    process = self._processes.get(known.newest)
                    left = process is not None and process.stats.leaving
                    self._notes.append(f"{name} {'left' if left else 'was lost'}")
            notes = list(self._notes)
            self._notes.clear()
        return notes

    def alive(self, role: str) -> set[str]:
        """Names of the living."""
        with self._lock:
            return {
                name for (its, name), known in self._names.items() if known.alive and its == role
            }

    def totals(self) -> tuple[Values, tuple[int, ...]]:
        """Returns figures, and how long the hands took (`common.press_latency`), over all processes
        there ever were."""
        with self._lock:
            self._fold(time.monotonic())
            total = _total((self._gone, *(process.totals for process in self._processes.values())))
            excess = self._gone_excess + sum(each.excess for each in self._processes.values())
        values: dict[str, Value] = {
            **{key: getattr(total, name) for name, key in TOTALS.items()},
            "stream/chunks_excess": excess,
            "actors/elapsed_per_step": total.decisions / total.steps if total.steps else None,
        }
        return values, total.key_times

    def actors(self) -> tuple[ActorView, ...]:
        """All that were here since this learner began, the newest process of each name."""
        now = time.monotonic()
        with self._lock:
            found = []
            for (role, name), known in sorted(self._names.items()):
                if role not in ("actor", "evaluator") or known.alive is None:
                    continue
                process = self._processes.get(known.newest)
                stats = process.stats if process else ActorStats(name, cast(Role, role))
                silent = now - known.heard
                # Not lost before it is clear that it says nothing more.
                alive = known.alive or (known.lost is not None and not stats.leaving)
                if not alive:
                    stats = replace(stats, steps_per_second=0.0, held_share=0.0, busy_cores=0.0)
                left = not alive and (process is None or stats.leaving) and silent > LEFT_SHOWN
                found.append(ActorView(stats=stats, alive=alive, silent_for=silent, left=left))
            return tuple(found)

    def _fold(self, now: float) -> None:
        """Add to the totals what has gone: at once if another process has its name, and the oldest
        where too many are kept."""
        ranked = []
        for incarnation, process in self._processes.items():
            key = process.stats.role, process.stats.name
            known = self._names.get(key, _Name())
            by_name = known.newest in (-1, incarnation)
            gone = now - process.heard > _SETTLED and not (by_name and known.alive)
            ranked.append((not gone, by_name, process.heard, incarnation, key))
        ranked.sort()
        gone_ones = sum(not stays for stays, *_ in ranked)
        replaced_ones = sum(not stays and not by_name for stays, by_name, *_ in ranked)
        many = max(replaced_ones, gone_ones - _MOST_GONE, len(ranked) - _MOST_KNOWN)
        for _, by_name, _, incarnation, key in ranked[:many]:
            process = self._processes.pop(incarnation)
            self._gone = _total((self._gone, process.totals))
            self._gone_excess += process.excess
            awaited = process.made - process.stats.refused - process.accepted
            self._folded[incarnation] = _Folded(process.stats.leaving, max(awaited, 0))
            if by_name:
                self._names.pop(key, None)
        self._names = {
            name: known
            for name, known in self._names.items()
            if known.alive or known.newest in self._processes or now - known.heard <= _SETTLED
        }
        for incarnation in list(self._folded)[:-_MOST_KNOWN]:
            del self._folded[incarnation]

    def _on_stats(self, message: Envelope) -> None:
        try:
            stats = ActorStats.decode(message.payload)
        except MessageError:
            return  # somebody else's noise on our key
        if not message.key.endswith(f"/{stats.role}/{stats.name}") or stats.run_id != self._run_id:
            return
        now = time.monotonic()
        with self._lock:
            known = self._known(stats.role, stats.name)
            if known is not None and stats.incarnation not in self._folded:
                process = self._processes.setdefault(stats.incarnation, _Process(stats))
                if not (known.shared or stats.leaving) and self._shares(process, known.newest, now):
                    known.shared = True
                    self._notes.append(
                        f"two processes are called {stats.name}, and take each other's work: give "
                        "each a --name of its own"
                    )
                process.hear(stats, now)
                known.newest, known.heard = stats.incarnation, now

    def _shares(self, process: _Process, heard_last: int, now: float) -> bool:
        """Whether a process speaks that another one of its name has not followed, but joined."""
        other = self._processes.get(heard_last, process)
        return process.born < other.born < now - _LONGEST_DELAY

    def _known(self, role: str, name: str) -> _Name | None:
        """Returns what is known of a name; None for one that is not valid, or one too many."""
        known = self._names.get((role, name))
        if known is None and len(self._names) < _MOST_KNOWN and re.fullmatch(NAME, name):
            known = self._names[role, name] = _Name()
        return known

    def _on_presence(self, key: str, alive: bool) -> None:
        role, name = key.split("/")[-2:]
        now = time.monotonic()
        with self._lock:
            if (known := self._known(role, name)) is None:
                return
            if alive and not known.alive and known.lost is None:  # else nobody was told of its loss
                self._notes.append(f"{name} joined")
            known.alive, known.heard = alive, now
            known.lost = None if alive else now


def _stats_from(state: dict[str, Any]) -> ActorStats:
    """Counters of a checkpoint, which may lack some or have others."""
    known = {name: value for name, value in state.items() if name in _KNOWN}
    return ActorStats(**{**known, "key_times": tuple(known.get("key_times", ()))})


def _total(processes: Iterable[ActorStats]) -> ActorStats:
    """Returns the sums of all counters, as those of one process."""
    every = list(processes)
    counts = (each.key_times for each in every if each.key_times)
    return ActorStats(
        "gone",
        "actor",
        **{name: sum(getattr(each, name) for each in every) for name in TOTALS},
        key_times=tuple(map(sum, zip(*counts, strict=True))),
    )
