"""The registry of actors and evaluators: their counters, and which of them are alive."""

import math
import re
import threading
import time
from collections import deque
from collections.abc import Iterable
from dataclasses import asdict, astuple, dataclass, fields, replace
from typing import Any, cast, get_args

from common.checked import NAME
from common.errors import MessageError
from common.metrics import Value, Values
from common.protocol.actor_stats import TOTALS, ActorStats, Role
from common.protocol.run_keys import RunKeys
from common.schedule import Now
from common.transport.interface import Envelope, Transport
from learner.telemetry.actor_process import LONGEST_DELAY, ActorProcess
from learner.telemetry.snapshot import ActorView
from replay.chunk_statistics import ChunkStatistics

_LAST_WORDS = 1.0
"""Seconds for which the last counters of a leaving process may arrive after its liveliness token
has gone."""
LEFT_SHOWN = 10.0
"""Seconds for which an actor that left stays on the display."""
_SETTLED = 60.0
"""Seconds after which the last counters and chunks of a process that has gone must have arrived."""
_MAX_GONE = 256
"""Number of processes that are kept one by one after they have gone; older ones only count in the
totals."""
_MAX_KNOWN = 4_096
"""Maximum number of processes, of names and of notes, however many heartbeats arrive."""
_KNOWN = {each.name for each in fields(ActorStats)}


@dataclass
class _Folded:
    """What is kept of a process that only counts in the totals."""

    leaving: bool
    """Whether it said farewell."""
    awaited: int = 0
    """Chunks that it announced and the replay has not stored yet; the totals include them."""


@dataclass
class _Name:
    """What is known of the processes with one role and name."""

    newest: int = -1
    """Incarnation that was heard last; -1 for none."""
    alive: bool | None = None
    """Whether the liveliness token is present; None if there never was one."""
    heard: float = -math.inf
    """Monotonic seconds of the last sign of life, a token or a heartbeat."""
    shared: bool = False
    """Whether two processes have this name at the same time."""
    lost: float | None = None
    """Monotonic seconds at which the token went; None once it is noted how the process left."""


class ActorRegistry:
    """Listens to heartbeats and liveliness tokens; safe to ask from any thread."""

    def __init__(self, transport: Transport, keys: RunKeys, now: Now = time.monotonic) -> None:
        self._now = now
        self._lock = threading.Lock()
        self._run_id = keys.run_id
        self._names: dict[tuple[Role, str], _Name] = {}
        """By role and name."""
        self._processes: dict[int, ActorProcess] = {}
        """Processes by incarnation; of those that have gone, the latest `_MAX_GONE`."""
        self._gone = _total(())
        """Totals of all other processes."""
        self._gone_excess = 0
        self._folded: dict[int, _Folded] = {}
        """The processes in these totals, by incarnation."""
        self._notes: deque[str] = deque(maxlen=_MAX_KNOWN)
        self._subscriptions = (
            transport.subscribe(keys.stats("*", "*"), self._on_stats),
            transport.watch_presence(keys.live("*", "*"), self._on_presence),
        )

    def restore(self, state: Any) -> None:
        """Restores the processes of a checkpoint, so that counts go on from there."""
        if isinstance(state, list):  # a checkpoint from before totals were kept
            state = {"processes": state, "gone": [], "excess": 0, "folded": []}
        with self._lock:
            for each in state["processes"]:
                stats = _stats_from(each)
                # A process that still runs may have sent a heartbeat already: keep its counters.
                process = self._process(stats, self._now())
                process.accepted = each.get("accepted", 0)
            self._gone = _total(map(_stats_from, state["gone"]))
            self._gone_excess = state["excess"]
            self._folded = {incarnation: _Folded(*kept) for incarnation, *kept in state["folded"]}
            for incarnation in self._folded:  # one that was away may have been heard by now
                self._processes.pop(incarnation, None)

    def state(self) -> dict[str, Any]:
        """Returns all processes that ever took part, of JSON's types."""
        with self._lock:
            self._fold(self._now())
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
        """Credits an actor with a chunk that the replay has stored; call it once for each chunk."""
        with self._lock:
            if folded := self._folded.get(chunk.incarnation):
                if folded.awaited:
                    folded.awaited -= 1
                elif folded.leaving:
                    self._gone_excess += 1
                else:
                    self._gone.made += 1
            elif chunk.incarnation:
                now = self._now()
                process = self._process(ActorStats(chunk.actor, "actor", chunk.incarnation), now)
                process.accepted += 1
                process.heard = now

    def take_notes(self) -> list[str]:
        """Returns the arrivals and losses since the last call, as sentences."""
        now = self._now()
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
        """Returns the names of the processes of a role that are alive."""
        with self._lock:
            return {
                name for (its, name), known in self._names.items() if known.alive and its == role
            }

    def totals(self) -> tuple[Values, tuple[int, ...]]:
        """Returns sums over all processes that ever took part: the figures, and the key times of
        the hands (`common.press_latency`)."""
        with self._lock:
            self._fold(self._now())
            total = _total((self._gone, *(process.totals for process in self._processes.values())))
            excess = self._gone_excess + sum(each.excess for each in self._processes.values())
        values: dict[str, Value] = {
            **{key: getattr(total, name) for name, key in TOTALS.items()},
            "stream/chunks_excess": excess,
            "actors/elapsed_per_step": total.decisions / total.steps if total.steps else None,
        }
        return values, total.key_times

    def actors(self) -> tuple[ActorView, ...]:
        """Returns all that took part since this learner started, with the newest process of each
        name."""
        now = self._now()
        with self._lock:
            found = []
            for (role, name), known in sorted(self._names.items()):
                if known.alive is None:
                    continue
                process = self._processes.get(known.newest)
                stats = process.stats if process else ActorStats(name, role)
                silent = now - known.heard
                # It counts as alive until it is clear that no farewell follows.
                alive = known.alive or (known.lost is not None and not stats.leaving)
                if not alive:
                    stats = replace(
                        stats, steps_per_second=0.0, throttled_share=0.0, busy_cores=0.0
                    )
                left = not alive and (process is None or stats.leaving) and silent > LEFT_SHOWN
                found.append(ActorView(stats=stats, alive=alive, silent_for=silent, left=left))
            return tuple(found)

    def _fold(self, now: float) -> None:
        """Moves processes that have gone into the totals.

        This happens at once if another process has the name, and to the oldest ones if too many
        are kept.
        """
        ranked = []
        for incarnation, process in self._processes.items():
            known = self._names.get((process.stats.role, process.stats.name), _Name())
            by_name = known.newest in (-1, incarnation)
            gone = now - process.heard > _SETTLED and not (by_name and known.alive)
            ranked.append((not gone, by_name, process.heard, incarnation))
        ranked.sort()
        gone_ones = sum(not stays for stays, *_ in ranked)
        replaced_ones = sum(not stays and not by_name for stays, by_name, *_ in ranked)
        many = max(replaced_ones, gone_ones - _MAX_GONE, len(ranked) - _MAX_KNOWN)
        for *_, incarnation in ranked[:many]:
            process = self._processes.pop(incarnation)
            self._gone = _total((self._gone, process.totals))
            self._gone_excess += process.excess
            awaited = process.made - process.stats.refused - process.accepted
            self._folded[incarnation] = _Folded(process.stats.leaving, max(awaited, 0))
        self._names = {
            name: known
            for name, known in self._names.items()
            if known.alive or known.newest in self._processes or now - known.heard <= _SETTLED
        }
        for incarnation in list(self._folded)[:-_MAX_KNOWN]:
            del self._folded[incarnation]

    def _on_stats(self, message: Envelope) -> None:
        try:
            stats = ActorStats.decode(message.payload)
        except MessageError:
            return  # not a heartbeat
        if not message.key.endswith(f"/{stats.role}/{stats.name}") or stats.run_id != self._run_id:
            return
        now = self._now()
        with self._lock:
            known = self._known(stats.role, stats.name)
            if known is not None and stats.incarnation not in self._folded:
                process = self._process(stats, now)
                if not (known.shared or stats.leaving) and self._shares(process, known.newest, now):
                    known.shared = True
                    self._notes.append(
                        f"two processes are called {stats.name}, and take each other's work: give "
                        "each a --name of its own"
                    )
                process.hear(stats, now)
                known.newest, known.heard = stats.incarnation, now

    def _process(self, stats: ActorStats, now: float) -> ActorProcess:
        """Returns the process that sent ``stats``, as it is known; otherwise a new one."""
        new = ActorProcess(stats, born=now, heard=now)
        return self._processes.setdefault(stats.incarnation, new)

    def _shares(self, process: ActorProcess, heard_last: int, now: float) -> bool:
        """Returns whether two processes of this name run at the same time: the older one still
        speaks after the newer one."""
        other = self._processes.get(heard_last, process)
        return process.born < other.born < now - LONGEST_DELAY

    def _known(self, role: Role, name: str) -> _Name | None:
        """Returns what is known of a name; None if the name is invalid, or there are too many."""
        known = self._names.get((role, name))
        if known is None and len(self._names) < _MAX_KNOWN and re.fullmatch(NAME, name):
            known = self._names[role, name] = _Name()
        return known

    def _on_presence(self, key: str, alive: bool) -> None:
        *_, role, name = key.split("/")
        if role not in get_args(Role):
            return
        now = self._now()
        with self._lock:
            if (known := self._known(cast(Role, role), name)) is None:
                return
            if alive and not known.alive and known.lost is None:  # otherwise no loss was noted
                self._notes.append(f"{name} joined")
            known.alive, known.heard = alive, now
            known.lost = None if alive else now


def _stats_from(state: dict[str, Any]) -> ActorStats:
    """Returns the counters in a checkpoint, which may lack some or have unknown ones. Raises
    MessageError if hands were timed in other bins."""
    known = {name: value for name, value in state.items() if name in _KNOWN}
    stats = ActorStats(**{**known, "key_times": tuple(known.get("key_times", ()))})
    stats.check()
    return stats


def _total(processes: Iterable[ActorStats]) -> ActorStats:
    """Returns the sums of all counters, as the counters of one process."""
    every = list(processes)
    counts = (each.key_times for each in every if each.key_times)
    return ActorStats(
        "gone",
        "actor",
        **{name: sum(getattr(each, name) for each in every) for name in TOTALS},
        key_times=tuple(map(sum, zip(*counts, strict=True))),
    )
