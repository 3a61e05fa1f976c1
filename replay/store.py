"""`Store`: the data of a run's replay, in files and in RAM.

An insert has these steps: make room (journaled before anything is overwritten) → write the data →
journal the chunk → link its steps and make them sampleable. A process killed in between has not
acknowledged the chunk, and its successor finds everything that was acknowledged before.

One insert passes at a time, and writes files without blocking readers. Only changes in RAM are made
under the lock that readers share.
"""

import threading
import uuid
from collections.abc import Iterable
from contextlib import ExitStack
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.errors import NO_ROOM_ERRORS, MessageError
from common.protocol.chunk import Chunk
from common.registry import SAMPLERS
from common.run.folder import JOURNAL
from common.settings.config import RunConfig
from replay.checked_sampler import CheckedSampler
from replay.chunk_index import ChunkKey, chunk_entry, tail_entry
from replay.chunk_statistics import ChunkStatistics
from replay.columns import Columns
from replay.curriculum import curriculum_steps
from replay.journal import Entry, Journal
from replay.recovery import header_of, read_index, restore
from replay.ring import Placement, Ring
from replay.sum_tree import padded

_SPARE_BYTES = 60_000
"""Bytes by which a journal may always grow before it is rewritten, about 200 chunks."""


class Store:
    """Ring, chunk index, journal and sampler of one run, kept consistent.

    ``index``, ``ring`` and ``sampler`` may be read under the given lock ``state``.
    """

    def __init__(self, config: RunConfig, folder: Path, state: threading.Condition) -> None:
        """See `ReplayBuffer`."""
        self._config = config
        self._actions = config.action_count
        self._state = state
        self._writer = threading.Lock()
        self._closed = False
        self._quarantined: set[int] = set()
        path = folder / JOURNAL
        self.index, known = read_index(path, config)
        self.uuid = known or uuid.uuid4().hex
        """Identity of this ring, which is made with it."""
        prioritised, existing = SAMPLERS.find(config.replay.sampler).prioritised, path.exists()
        self.columns = Columns(
            folder,
            config.replay.capacity,
            config.vector_width,
            priority_slots=padded(config.replay.capacity) if prioritised else 0,
            existing=existing,
        )
        with ExitStack() as failed:
            failed.callback(self.columns.discard)
            if not existing:
                failed.callback(path.unlink, missing_ok=True)
            self.ring = Ring(self.columns, config)
            alive = restore(self.ring, self.index, folder)
            self.sampler = CheckedSampler(alive, self.columns.priorities, config.replay)
            self._journal = Journal(path, self._entries())
            failed.pop_all()
        self._compacted_size = self._journal.size

    def _entries(self) -> Iterable[Entry]:
        return chain([{**header_of(self._config), "uuid": self.uuid}], self.index.entries())

    def insert(self, chunk: Chunk, staleness: int) -> bool:
        """See `ReplayBuffer.insert`; returns False if the chunk was received before."""
        try:
            self._check(chunk)
        except MessageError:
            self.count_refused()
            raise
        key = ChunkKey(chunk.actor, chunk.incarnation, chunk.stream, chunk.sequence)
        with self._writer:
            if self._closed:
                raise OSError("the replay is closed")
            if self.index.has_received(key):
                self.index.duplicates += 1
                self._append_counts()
                return False
            place = self.ring.write(self._place(key, chunk), chunk)
            statistics = self._statistics(chunk, staleness)
            self._append(chunk_entry(key, place, statistics))
            with self._state:
                self._accept(key, place, statistics)
                self._state.notify_all()
            return True

    def _append(self, entry: Entry) -> None:
        """Appends ``entry`` to the journal, which is first rewritten if it has grown too long."""
        if self._journal.size > 2 * self._compacted_size + _SPARE_BYTES:
            self._journal.rewrite(self._entries())
            self._compacted_size = self._journal.size
        self._journal.append(entry)

    def _append_counts(self) -> None:
        """Appends the counts. A full disk keeps no sender from its answer: the next entry of counts
        has them all."""
        try:
            self._append(self.index.counts_entry())
        except OSError as error:
            if error.errno not in NO_ROOM_ERRORS:
                raise

    def quarantine(self, ids: NDArray[np.int64]) -> tuple[list[int], list[str]]:
        """Excludes steps ``ids`` from further draws; returns those that exist, and their actors.

        Called under ``state``.
        """
        ids = np.unique(ids[self.sampler.contains(ids)])
        if not ids.size:  # the usual case: do not walk through all chunks
            return [], []
        self.sampler.remove(ids)
        alive = {each for each in self._quarantined if each >= self.ring.tail}
        self._quarantined = alive | set(ids.tolist())
        bases = np.array([place.base for place in self.index.chunks.values()], np.int64)
        keys = list(self.index.chunks)
        senders = {keys[at].actor for at in bases.searchsorted(ids, "right") - 1}
        return ids.tolist(), sorted(senders)

    def count_refused(self) -> None:
        """Counts a chunk that could not be accepted."""
        with self._writer:
            self.index.refused += 1
            if not self._closed:
                self._append_counts()

    def sync(self) -> None:
        """Puts everything that was acknowledged so far on the disk."""
        self.columns.sync()
        self._journal.sync()  # a rewritten journal was on the disk before it took the file's place

    def close(self) -> None:
        """Refuses further inserts and closes the files; what was stored can still be read."""
        with self._writer:
            self._closed = True
            self._journal.close()
            self.columns.close()

    def _check(self, chunk: Chunk) -> None:
        width = chunk.vectors.shape[1]
        most = self._config.play.frame_stack - 1
        slots = len(chunk.context) + len(chunk) + len(chunk.final_frames)
        if width != self._config.vector_width:
            raise MessageError(
                f"vectors of {width} numbers where the run has {self._config.vector_width}"
            )
        if len(chunk.context) > most:
            raise MessageError(f"{len(chunk.context)} context frames where {most} are stacked")
        if slots > self._config.replay.capacity:
            raise MessageError(f"{slots} frames do not fit the ring")
        if (chunk.actions >= self._actions).any():
            raise MessageError(f"actions should be less than {self._actions}")

    def _place(self, key: ChunkKey, chunk: Chunk) -> Placement:
        """Makes room for the chunk, and returns its place."""
        ring, index = self.ring, self.index
        steps, finals, context = len(chunk), len(chunk.final_frames), len(chunk.context)
        self._make_room(steps + finals)
        before, previous = index.chunks.get(key.beside(-1)), -1
        if context and before is not None and ring.is_open(before):
            last = before.last
            if ring.can_lend(last):
                previous, context = last, 0
        self._make_room(context + steps + finals)
        return Placement(ring.head, context, steps, finals, previous)

    def _make_room(self, count: int) -> None:
        """Evicts the oldest chunks until ``count`` slots are free."""
        ring, index = self.ring, self.index
        least = ring.head + count - self._config.replay.capacity
        tail = ring.tail
        for place in index.chunks.values():
            if place.base >= least:
                break
            tail = place.end
        tail = max(tail, least)  # damaged chunks have left ids that belong to no chunk
        if tail == ring.tail:
            return
        # The eviction is journaled first: the slots are about to be overwritten, and a successor of
        # this process must not read them as the old steps.
        self._append(tail_entry(tail))
        with self._state:
            touched = set(range(ring.tail, tail))
            ring.tail = tail
            for key in index.evict(tail):
                touched |= self._steps_beside(key)
            ids = np.array(sorted(touched), np.int64)
            ids = ids[self.sampler.contains(ids)]
            self.sampler.remove(ids[~ring.is_complete(ids)])

    def _steps_beside(self, key: ChunkKey) -> set[int]:
        """Returns steps whose return or whose stack may reach into the chunk."""
        n_step, frame_stack = self._config.learning.n_step, self._config.play.frame_stack
        return self.index.steps_beside(key, n_step, frame_stack - 1)

    def _statistics(self, chunk: Chunk, staleness: int) -> ChunkStatistics:
        past, agent_steps = self.index.statistics, self.index.agent_steps + len(chunk)
        return ChunkStatistics(
            index=self.index.accepted,
            agent_steps=agent_steps,
            steps=len(chunk),
            actor=chunk.actor,
            epsilon=chunk.epsilon,
            weights_version=chunk.weights_version,
            staleness=staleness,
            valid=int(np.count_nonzero(chunk.valid)),
            matched=int(np.count_nonzero(chunk.matched)),
            games=chunk.games,
            incarnation=chunk.incarnation,
            stream=chunk.stream,
            follows=int(np.count_nonzero(chunk.follows)),
            curriculum_steps=curriculum_steps(self._config, past, agent_steps, len(chunk)),
        )

    def _accept(self, key: ChunkKey, place: Placement, statistics: ChunkStatistics) -> None:
        ring, index = self.ring, self.index
        index.accept(key, place, statistics)
        ring.head = place.end
        ring.link(place)
        before, after = (index.chunks.get(key.beside(distance)) for distance in (-1, 1))
        if before is not None:
            ring.join(before, place)
        if after is not None:
            ring.join(place, after)
        touched = self._steps_beside(key) | set(range(place.first, place.last + 1))
        touched -= self._quarantined
        ids = np.array(sorted(touched), np.int64)
        ids = ids[~self.sampler.contains(ids)]
        self.sampler.add(ids[ring.is_complete(ids)])
