"""Which chunks there are and which there have been: the replay's index.

Everything here can be written as journal entries and be read back from them, in order.
"""

from bisect import bisect_left
from collections import deque
from collections.abc import Iterator
from itertools import accumulate, islice, takewhile
from typing import NamedTuple

from common.checked import build
from common.run.config import MAX_WINDOW
from replay.chunk_statistics import MAX_GAMES, MAX_STATISTICS, ChunkStatistics
from replay.journal import Entry
from replay.ring import Placement

_KEPT_STATISTICS = 4 * MAX_STATISTICS
_KEPT_GAMES = 16 * _KEPT_STATISTICS
"""Maximum number of games in all of them, about 30 MB. Catch has the shortest games, of six steps,
so a chunk of 64 steps holds at most eleven. If an actor claims a game for each step, fewer chunks
are kept."""
_MOST_GAPS = MAX_WINDOW  # before any chunk that is under way there may be one
_MOST_STREAMS = 65_536
"""Streams that are remembered beyond their chunks in the ring, those that were heard last. Each
start of an actor begins some."""


class ChunkKey(NamedTuple):
    """What makes a chunk the same chunk, however often it is sent."""

    actor: str
    incarnation: int
    stream: int
    sequence: int

    def beside(self, distance: int) -> "ChunkKey":
        """Returns the key of the chunk so many places after this one in its stream."""
        return self._replace(sequence=self.sequence + distance)


class Received:
    """Sequence numbers of one stream that have come, as the gaps below the highest."""

    def __init__(self, highest: int = -1, gaps: list[list[int]] | None = None) -> None:
        self.highest = highest
        self.gaps = gaps or []
        """``[first, last]`` missing; beyond `_MOST_GAPS` the oldest are given up as lost."""

    def __contains__(self, sequence: int) -> bool:
        return sequence <= self.highest and not any(
            first <= sequence <= last for first, last in self.gaps
        )

    def add(self, sequence: int) -> None:
        """Note ``sequence``, which is not in here."""
        if sequence > self.highest:
            if sequence > self.highest + 1:
                self.gaps.append([self.highest + 1, sequence - 1])
                del self.gaps[:-_MOST_GAPS]
            self.highest = sequence
            return
        for at, (first, last) in enumerate(self.gaps):
            if first <= sequence <= last:
                halves = [[first, sequence - 1], [sequence + 1, last]]
                self.gaps[at : at + 1] = [half for half in halves if half[0] <= half[1]]
                return


class ChunkIndex:
    """Chunks in the ring, oldest first, and counters since the run began."""

    def __init__(self) -> None:
        self.agent_steps = 0
        self.stored = 0
        """Steps in the ring."""
        self.accepted = 0
        self.duplicates = 0
        self.refused = 0
        self.tail = 0
        """Ids below it are evicted."""
        self.head = 0
        """Id that the next chunk starts from; never falls, so that no id is used twice."""
        self.statistics: deque[ChunkStatistics] = deque()
        """Of the newest chunks. The learner has counted some of them already: if it is killed, it
        asks for them again, from its checkpoint on."""
        self._kept_games = 0
        self.chunks: dict[ChunkKey, Placement] = {}
        """Those in the ring, oldest first."""
        self._received: dict[tuple[str, int, int], Received] = {}
        """By actor, incarnation and stream, the one that was heard last at the end."""

    @property
    def curriculum_steps(self) -> int:
        """Steps that the curriculum has gone on."""
        return self.statistics[-1].curriculum_steps if self.statistics else 0

    def has_received(self, key: ChunkKey) -> bool:
        """Whether this chunk came before, even if it is evicted by now."""
        received = self._received.get(key[:3])
        return key in self.chunks or (received is not None and key.sequence in received)

    def steps_beside(self, key: ChunkKey, before: int, after: int) -> set[int]:
        """Ids of the nearest steps of the chunk's stream, as far as their chunks follow it."""
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
        """Count a chunk that is written."""
        received = self._received.pop(key[:3], None) or Received()
        received.add(key.sequence)
        self._received[key[:3]] = received
        if len(self._received) > _MOST_STREAMS:
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
        """Strike the chunks that lie below ``tail``."""
        below = takewhile(lambda chunk: chunk[1].base < tail, self.chunks.items())
        gone = [key for key, _ in below]
        self.stored -= sum(self.chunks.pop(key).steps for key in gone)
        self.tail = tail
        self.head = max(self.head, tail)
        return gone

    def drop(self, key: ChunkKey) -> None:
        """Strike a chunk whose rows are damaged."""
        self.stored -= self.chunks.pop(key).steps

    def statistics_since(self, index: int) -> tuple[ChunkStatistics, ...]:
        """The oldest statistics from ``index`` on that are still kept, as many as one `Progress`
        holds."""
        # Numbers are missing where a journal was damaged.
        begin = bisect_left(self.statistics, index, key=lambda each: each.index)
        portion = list(islice(self.statistics, begin, begin + MAX_STATISTICS))
        totals = accumulate(len(each.games) for each in portion)
        pairs = zip(portion, totals, strict=True)
        return tuple(each for each, games in pairs if games <= MAX_GAMES)

    def entries(self) -> Iterator[Entry]:
        """Journal entries from which `apply` makes this index again."""
        yield {
            "kind": "state",
            "agent_steps": self.agent_steps,
            "accepted": self.accepted,
            "tail": self.tail,
            "head": self.head,
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
        """The entry that counts what was not stored."""
        return {"kind": "counts", "duplicates": self.duplicates, "refused": self.refused}

    def apply(self, entry: Entry) -> None:
        """Do what a journal entry says. Raises KeyError, TypeError or ValueError if it is not a
        valid entry."""
        kind = entry["kind"]
        if kind == "state":
            self.agent_steps = entry["agent_steps"]
            self.accepted = entry["accepted"]
            self.tail = entry["tail"]
            self.head = entry.get("head", self.tail)  # former journals have none
            for actor, incarnation, stream, highest, gaps in entry["received"]:
                self._received[actor, incarnation, stream] = Received(highest, gaps)
        elif kind == "counts":
            self.duplicates = entry["duplicates"]
            self.refused = entry["refused"]
        elif kind == "facts":
            self._keep(build(ChunkStatistics, entry["facts"]))
        elif kind == "held":
            self._hold(*_chunk(entry))
        elif kind == "chunk":
            self.accept(*_chunk(entry), build(ChunkStatistics, entry["facts"]))
        elif kind == "tail":
            self.evict(entry["tail"])
        else:
            raise ValueError(kind)


def chunk_entry(key: ChunkKey, place: Placement, statistics: ChunkStatistics) -> Entry:
    """The entry by which a chunk is accepted."""
    return {"kind": "chunk", "key": key, "placement": place, "facts": statistics}


def tail_entry(tail: int) -> Entry:
    """The entry by which chunks are evicted."""
    return {"kind": "tail", "tail": tail}


def _chunk(entry: Entry) -> tuple[ChunkKey, Placement]:
    return build(ChunkKey, entry["key"]), build(Placement, entry["placement"])
