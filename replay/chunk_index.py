"""`ChunkIndex`: the chunks that are in the replay, and those that have been.

The index can be written as journal entries, and rebuilt from them in order.
"""

from bisect import bisect_left
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate, islice, takewhile
from typing import Annotated, NamedTuple

from pydantic import Strict

from common.checked import Count, Rows, Values, build
from common.settings.config import MAX_WINDOW
from replay.chunk_statistics import MAX_GAMES, MAX_STATISTICS, ChunkStatistics
from replay.journal import Entry
from replay.ring import Placement

_KEPT_STATISTICS = 4 * MAX_STATISTICS
_KEPT_GAMES = 16 * _KEPT_STATISTICS
"""Maximum number of games in all kept statistics, about 30 MB. Catch has the shortest games, of six
steps, so a chunk of 64 steps holds at most eleven. If an actor claims a game for each step, fewer
chunks are kept."""
_MAX_GAPS = MAX_WINDOW  # there may be one before each chunk under way
_MAX_STREAMS = 65_536
"""Maximum number of streams that are remembered beyond their chunks in the ring; the latest are
kept. Each start of an actor begins some."""


class ChunkKey(NamedTuple):
    """The identity of a chunk, which is the same however often the chunk is sent."""

    actor: str
    incarnation: int
    stream: int
    sequence: int

    def beside(self, distance: int) -> "ChunkKey":
        """Returns the key of the chunk so many places after this one in its stream."""
        return self._replace(sequence=self.sequence + distance)


class Received:
    """The received sequence numbers of one stream: the highest, and the gaps below it."""

    def __init__(self, highest: int = -1, gaps: list[list[int]] | None = None) -> None:
        self.highest = highest
        self.gaps = gaps or []
        """Missing ranges ``[first, last]``; beyond `_MAX_GAPS`, the oldest are given up as
        lost."""

    def __contains__(self, sequence: int) -> bool:
        return sequence <= self.highest and not any(
            first <= sequence <= last for first, last in self.gaps
        )

    def add(self, sequence: int) -> None:
        """Adds ``sequence``, which has not been received yet."""
        if sequence > self.highest:
            if sequence > self.highest + 1:
                self.gaps.append([self.highest + 1, sequence - 1])
            self.highest = sequence
        for at, (first, last) in enumerate(self.gaps):
            if first <= sequence <= last:
                halves = [[first, sequence - 1], [sequence + 1, last]]
                self.gaps[at : at + 1] = [half for half in halves if half[0] <= half[1]]
                break
        del self.gaps[:-_MAX_GAPS]


class _Stream(NamedTuple):
    """The state of a stream in the journal."""

    actor: str
    incarnation: Count
    stream: Count
    highest: Count
    gaps: Values[Annotated[tuple[Count, Count], Strict(False)]]


@dataclass(frozen=True)
class _State:
    """The counters in the journal."""

    agent_steps: Count
    accepted: Count
    tail: Count
    head: Count
    received: Rows[_Stream]
    held: Count


class ChunkIndex:
    """The chunks in the ring, oldest first, and counters since the run began."""

    def __init__(self) -> None:
        self.agent_steps = 0
        self.stored = 0
        """Number of steps in the ring."""
        self.accepted = 0
        self.duplicates = 0
        self.refused = 0
        self.tail = 0
        """The oldest id alive; ids below it are evicted."""
        self.head = 0
        """First id of the next chunk. It never falls, so that no id is used twice."""
        self.unlisted = 0
        """Number of chunks that the journal from which this was rebuilt should list, and does
        not."""
        self.statistics: deque[ChunkStatistics] = deque()
        """Statistics of the newest chunks. A learner that was killed asks again for those that it
        counted after its checkpoint."""
        self._kept_games = 0
        self.chunks: dict[ChunkKey, Placement] = {}
        """The chunks in the ring, oldest first."""
        self._received: dict[tuple[str, int, int], Received] = {}
        """By actor, incarnation and stream; the stream heard last is at the end."""

    @property
    def curriculum_steps(self) -> int:
        """Number of steps by which the curriculum has advanced."""
        return self.statistics[-1].curriculum_steps if self.statistics else 0

    def has_received(self, key: ChunkKey) -> bool:
        """Whether this chunk was received before, even if it has been evicted since."""
        received = self._received.get(key[:3])
        return key in self.chunks or (received is not None and key.sequence in received)

    def steps_beside(self, key: ChunkKey, before: int, after: int) -> set[int]:
        """Returns ids of up to ``before`` and ``after`` steps next to the chunk in its stream, as
        far as the neighbouring chunks are in the ring."""
        found: set[int] = set()
        for direction, wanted in ((-1, before), (1, after)):
            at = key.beside(direction)
            while wanted > 0 and (place := self.chunks.get(at)) is not None:
                some = min(wanted, place.steps)
                begin = place.first if direction > 0 else place.last + 1 - some
                found.update(range(begin, begin + some))
                wanted, at = wanted - some, at.beside(direction)
        return found

    def accept(self, key: ChunkKey, place: Placement, statistics: ChunkStatistics) -> None:
        """Adds a chunk whose rows have been written."""
        received = self._received.pop(key[:3], None) or Received()
        received.add(key.sequence)
        self._received[key[:3]] = received
        if len(self._received) > _MAX_STREAMS:
            del self._received[next(iter(self._received))]
        self._hold(key, place)
        self.accepted = statistics.index + 1
        self.agent_steps = statistics.agent_steps
        self._keep(statistics)

    def _keep(self, statistics: ChunkStatistics) -> None:
        self.statistics.append(statistics)
        self._kept_games += len(statistics.games)
        while len(self.statistics) > _KEPT_STATISTICS or self._kept_games > _KEPT_GAMES:
            self._kept_games -= len(self.statistics.popleft().games)

    def _hold(self, key: ChunkKey, place: Placement) -> None:
        self.chunks[key] = place
        self.stored += place.steps
        self.head = max(self.head, place.end)

    def evict(self, tail: int) -> list[ChunkKey]:
        """Removes the chunks that lie below ``tail``; returns their keys."""
        below = takewhile(lambda chunk: chunk[1].base < tail, self.chunks.items())
        gone = [key for key, _ in below]
        self.stored -= sum(self.chunks.pop(key).steps for key in gone)
        self.tail = tail
        self.head = max(self.head, tail)
        return gone

    def drop(self, key: ChunkKey) -> None:
        """Removes a chunk whose rows are damaged."""
        self.stored -= self.chunks.pop(key).steps

    def statistics_since(self, index: int) -> tuple[ChunkStatistics, ...]:
        """Returns the oldest kept statistics from ``index`` on, as many as one answer holds."""
        # Indices are missing if a journal was damaged.
        begin = bisect_left(self.statistics, index, key=lambda each: each.index)
        portion = list(islice(self.statistics, begin, begin + MAX_STATISTICS))
        totals = accumulate(len(each.games) for each in portion)
        pairs = zip(portion, totals, strict=True)
        return tuple(each for each, games in pairs if games <= MAX_GAMES)

    def entries(self) -> Iterator[Entry]:
        """Yields journal entries from which `apply` rebuilds this index."""
        yield {
            "kind": "state",
            "agent_steps": self.agent_steps,
            "accepted": self.accepted,
            "tail": self.tail,
            "head": self.head,
            "held": len(self.chunks),
            "received": [
                [*stream, received.highest, received.gaps]
                for stream, received in self._received.items()
            ],
        }
        yield self.counts_entry()
        for statistics in self.statistics:
            yield {"kind": "facts", "facts": statistics}
        for key, place in self.chunks.items():
            yield {"kind": "held", "key": key, "placement": place}

    def counts_entry(self) -> Entry:
        """Returns the entry that holds the counts of chunks that were not stored."""
        return {"kind": "counts", "duplicates": self.duplicates, "refused": self.refused}

    def apply(self, entry: Entry) -> None:
        """Applies a journal entry. Raises KeyError, TypeError or ValueError if it is not valid."""
        kind = entry["kind"]
        if kind == "state":
            told = {"head": entry["tail"], "held": 0, **entry}  # former journals have neither
            state = build(_State, {name: told[name] for name in _State.__dataclass_fields__})
            self.agent_steps, self.accepted = state.agent_steps, state.accepted
            self.tail, self.head = state.tail, state.head
            self.unlisted = state.held
            for actor, incarnation, stream, highest, gaps in state.received:
                received = Received(highest, [list(gap) for gap in gaps])
                self._received[actor, incarnation, stream] = received
        elif kind == "counts":
            self.duplicates = build(Count, entry["duplicates"])
            self.refused = build(Count, entry["refused"])
        elif kind == "facts":
            self._keep(build(ChunkStatistics, entry["facts"]))
        elif kind == "held":
            self._hold(*_chunk(entry))
            self.unlisted -= 1
        elif kind == "chunk":
            self.accept(*_chunk(entry), build(ChunkStatistics, entry["facts"]))
        elif kind == "tail":
            self.evict(build(Count, entry["tail"]))
        else:
            raise ValueError(kind)


def chunk_entry(key: ChunkKey, place: Placement, statistics: ChunkStatistics) -> Entry:
    """Returns the entry that accepts a chunk."""
    return {"kind": "chunk", "key": key, "placement": place, "facts": statistics}


def tail_entry(tail: int) -> Entry:
    """Returns the entry that evicts the chunks below ``tail``."""
    return {"kind": "tail", "tail": tail}


def _chunk(entry: Entry) -> tuple[ChunkKey, Placement]:
    return build(ChunkKey, entry["key"]), build(Placement, entry["placement"])
