"""Which chunks there are and which there have been: the replay's index.

Everything here can be written as journal entries and be read back from them, in order.
"""

from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple

from common.checked import build
from replay.chunk_statistics import MAX_STATISTICS, ChunkStatistics
from replay.journal import Entry
from replay.ring import Placement

_KEPT_STATISTICS = 4 * MAX_STATISTICS
_MOST_GAPS = 64


class ChunkKey(NamedTuple):
    """What makes a chunk the same chunk, however often it is sent."""

    actor: str
    incarnation: int
    stream: int
    sequence: int


class ChunkRecord(NamedTuple):
    """A chunk that is in the ring."""

    key: ChunkKey
    placement: Placement


class Received:
    """Sequence numbers of one stream that have come, as the gaps below the highest."""

    def __init__(self, highest: int = -1, gaps: list[list[int]] | None = None) -> None:
        self.highest = highest
        self.gaps = gaps or []
        """``[first, last]`` missing; beyond 64 of them the oldest are given up as lost."""

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
        self.statistics: deque[ChunkStatistics] = deque(maxlen=_KEPT_STATISTICS)
        self._chunks: dict[ChunkKey, ChunkRecord] = {}
        self._received: dict[tuple[str, int, int], Received] = {}

    def has_received(self, key: ChunkKey) -> bool:
        """Whether this chunk came before, even if it is evicted by now."""
        received = self._received.get(key[:3])
        return received is not None and key.sequence in received

    def neighbour(self, key: ChunkKey, distance: int) -> ChunkRecord | None:
        """The chunk so many places after this one in its stream, if it is in the ring."""
        return self._chunks.get(key._replace(sequence=key.sequence + distance))

    def steps_beside(self, key: ChunkKey, before: int, after: int) -> set[int]:
        """Ids of the nearest steps of the chunk's stream, as far as their chunks follow it."""
        found: set[int] = set()
        for direction, wanted in ((-1, before), (1, after)):
            record = self.neighbour(key, direction)
            while wanted > 0 and record is not None:
                place = record.placement
                some = min(wanted, place.steps)
                begin = place.first if direction > 0 else place.last + 1 - some
                found.update(range(begin, begin + some))
                wanted -= some
                record = self.neighbour(record.key, direction)
        return found

    @property
    def chunks(self) -> Iterator[ChunkRecord]:
        return iter(self._chunks.values())

    def oldest(self) -> ChunkRecord | None:
        return next(self.chunks, None)

    @property
    def head(self) -> int:
        """Id that the next chunk starts from."""
        newest = next(reversed(self._chunks.values()), None)
        return self.tail if newest is None else newest.placement.end

    def accept(self, record: ChunkRecord, statistics: ChunkStatistics) -> None:
        """Count a chunk that is written."""
        self._received.setdefault(record.key[:3], Received()).add(record.key.sequence)
        self._chunks[record.key] = record
        self.stored += record.placement.steps
        self.accepted = statistics.index + 1
        self.agent_steps = statistics.agent_steps
        self.statistics.append(statistics)

    def evict(self, tail: int) -> list[ChunkRecord]:
        """Strike the chunks that lie below ``tail``."""
        gone: list[ChunkRecord] = []
        while (oldest := self.oldest()) is not None and oldest.placement.base < tail:
            gone.append(self._chunks.pop(oldest.key))
            self.stored -= oldest.placement.steps
        self.tail = tail
        return gone

    def statistics_since(self, index: int) -> tuple[ChunkStatistics, ...]:
        """The oldest `MAX_STATISTICS` statistics from ``index`` on that are still kept."""
        if not self.statistics:
            return ()
        begin = max(index - self.statistics[0].index, 0)
        end = min(begin + MAX_STATISTICS, len(self.statistics))
        return tuple(self.statistics[at] for at in range(begin, end))

    def entries(self) -> Iterator[Entry]:
        """Journal entries from which `apply` makes this index again."""
        yield {
            "kind": "state",
            "agent_steps": self.agent_steps,
            "accepted": self.accepted,
            "tail": self.tail,
            "received": [
                [*stream, received.highest, received.gaps]
                for stream, received in self._received.items()
            ],
        }
        yield self.counts_entry()
        for statistics in self.statistics:
            yield {"kind": "facts", "facts": statistics}
        for record in self._chunks.values():
            yield {"kind": "held", "key": record.key, "placement": record.placement}

    def counts_entry(self) -> Entry:
        """The entry that counts what was not stored."""
        return {"kind": "counts", "duplicates": self.duplicates, "refused": self.refused}

    def apply(self, entry: Entry) -> None:
        """Do what a journal entry says.

        Raises:
            KeyError, TypeError, ValueError: it is not a valid entry.
        """
        kind = entry["kind"]
        if kind == "state":
            self.agent_steps = entry["agent_steps"]
            self.accepted = entry["accepted"]
            self.tail = entry["tail"]
            for actor, incarnation, stream, highest, gaps in entry["received"]:
                self._received[actor, incarnation, stream] = Received(highest, gaps)
        elif kind == "counts":
            self.duplicates = entry["duplicates"]
            self.refused = entry["refused"]
        elif kind == "facts":
            self.statistics.append(build(ChunkStatistics, entry["facts"]))
        elif kind == "held":
            record = _record(entry)
            self._chunks[record.key] = record
            self.stored += record.placement.steps
        elif kind == "chunk":
            self.accept(_record(entry), build(ChunkStatistics, entry["facts"]))
        elif kind == "tail":
            self.evict(entry["tail"])
        else:
            raise ValueError(kind)


def chunk_entry(record: ChunkRecord, statistics: ChunkStatistics) -> Entry:
    """The entry by which a chunk is accepted."""
    return {
        "kind": "chunk",
        "key": record.key,
        "placement": record.placement,
        "facts": statistics,
    }


def tail_entry(tail: int) -> Entry:
    """The entry by which chunks are evicted."""
    return {"kind": "tail", "tail": tail}


def _record(entry: dict[str, Any]) -> ChunkRecord:
    return ChunkRecord(build(ChunkKey, entry["key"]), build(Placement, entry["placement"]))
