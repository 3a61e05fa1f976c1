"""`Memory`: the replay of a run, in one process and for many threads.

Two locks. ``_writer`` lets one insert at a time pass and covers its writing of files; ``_state``
covers only what is decided in RAM, so that a draw never waits for a file, nor an insert for a
minibatch to be gathered.

An insert: make room (journaled before anything is overwritten) → write the data → journal the
chunk → link and admit its steps. A process killed in between has not acknowledged the chunk.
"""

import threading
from collections.abc import Iterable
from itertools import chain
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from common.ack import Ack
from common.actions import KEYS_OF_ACTION
from common.chunk import Chunk
from common.config import RunConfig
from common.errors import InputError, MessageError
from replay.batch import Batch
from replay.columns import Columns
from replay.facts import ChunkFacts, Progress
from replay.footprint import footprint
from replay.journal import Entry, Journal, damaged, read_journal
from replay.ledger import ChunkKey, ChunkRecord, Ledger, chunk_entry, tail_entry
from replay.limiter import RateLimiter
from replay.ring import Placement, Ring
from replay.samplers import PrioritisedSampler, Sampler, UniformSampler
from replay.sum_tree import padded

FORMAT = 1
_HURRIED_READS = 3
_SPARE_LINES = 1_000


class Memory:
    """Everything remembered of one run; implements `replay.interface.Replay`."""

    def __init__(self, config: RunConfig, folder: Path) -> None:
        """Open the replay in ``folder``, or create it where there is none.

        Raises:
            InputError: no space, a replay of other sizes, a damaged one, or one in use.
        """
        self.weights_version = 0
        """Newest weights there are; told to actors with each acknowledgement."""
        self._config = config
        self._limiter = RateLimiter(
            config.samples_per_insert,
            config.replay.warmup,
            config.replay.ratio_tolerance,
            config.learning.batch_size,
        )
        self._writer = threading.Lock()
        self._state = threading.Condition()
        self._closed = False
        self._finished = False
        self._drawn = 0
        path = folder / "journal.jsonl"
        self._ledger = self._read(path)
        prioritised = config.replay.sampler == "prioritised"
        self._columns = Columns(
            folder,
            config.replay.capacity,
            config.vector_width,
            priority_slots=padded(config.replay.capacity) if prioritised else 0,
            existing=path.exists(),
        )
        self._ring = Ring(
            self._columns,
            history=config.play.history,
            n_step=config.learning.n_step,
            discount=config.learning.discount,
            clip_rewards=config.learning.clip_rewards,
        )
        self._sampler = self._new_sampler()
        self._rng = np.random.default_rng([config.seed, self._ledger.accepted])
        self._rebuild()
        self._journal = Journal(path, self._entries())
        self._compacted_lines = self._journal.lines

    @property
    def _header(self) -> Entry:
        return {
            "kind": "ring",
            "format": FORMAT,
            "capacity": self._config.replay.capacity,
            "history": self._config.play.history,
            "vector_width": self._config.vector_width,
        }

    def _read(self, path: Path) -> Ledger:
        ledger = Ledger()
        for number, entry in enumerate(read_journal(path), start=1):
            if number > 1:
                try:
                    ledger.apply(entry)
                except (KeyError, TypeError, ValueError):
                    raise damaged(path, number) from None
            elif unequal := [
                f"{name} {entry.get(name)} instead of {value}"
                for name, value in self._header.items()
                if entry.get(name) != value
            ]:
                raise InputError(
                    f"the replay in {path.parent} has {', '.join(unequal)}: resume it with the "
                    "settings it was made with, or name another run."
                )
        return ledger

    def _new_sampler(self) -> Sampler:
        settings = self._config.replay
        if settings.sampler == "uniform":
            return UniformSampler(settings.capacity)
        return PrioritisedSampler(
            settings.capacity,
            self._columns.priorities,
            settings.priority_exponent,
            settings.importance_exponent,
        )

    def _rebuild(self) -> None:
        """Links and admitted steps from the ledger and the files."""
        ring, ledger = self._ring, self._ledger
        ring.tail, ring.head = ledger.tail, ledger.head
        for record in ledger.chunks:
            ring.link(record.placement)
        for record in ledger.chunks:
            self._join(record, ledger.neighbour(record.key, 1))
        alive = np.arange(ring.tail, ring.head)
        self._sampler.restore(alive[ring.is_complete(alive)])

    def _entries(self) -> Iterable[Entry]:
        return chain([self._header], self._ledger.entries())

    def insert(self, chunk: Chunk) -> Ack:
        """Store ``chunk``, unless it came before.

        Raises:
            MessageError: it does not fit this run; it is counted as refused.
            OSError: the files could not be written; it may be sent again.
        """
        try:
            self._check(chunk)
        except MessageError:
            self.refuse()
            raise
        key = ChunkKey(chunk.actor, chunk.incarnation, chunk.stream, chunk.sequence)
        with self._writer:
            if self._closed:
                raise OSError("the replay is closed")
            if self._ledger.has_received(key):
                self._ledger.duplicates += 1
                self._journal.append(self._ledger.counts_entry())
                return self._ack("duplicate")
            record = ChunkRecord(key, self._place(key, chunk))
            self._ring.write(record.placement, chunk)
            facts = self._facts(chunk)
            self._journal.append(chunk_entry(record, facts))
            with self._state:
                self._admit(record, facts)
                self._state.notify_all()
            if self._journal.lines > 2 * self._compacted_lines + _SPARE_LINES:
                self._journal.rewrite(self._entries())
                self._compacted_lines = self._journal.lines
            return self._ack("stored")

    def refuse(self) -> None:
        """Count a chunk that could not be accepted."""
        with self._writer:
            self._ledger.refused += 1
            if not self._closed:
                self._journal.append(self._ledger.counts_entry())

    def _check(self, chunk: Chunk) -> None:
        width = chunk.vectors.shape[1]
        most = self._config.play.history - 1
        slots = len(chunk.context) + len(chunk) + len(chunk.final_frames)
        if width != self._config.vector_width:
            raise MessageError(
                f"vectors of {width} numbers where the run has {self._config.vector_width}"
            )
        if len(chunk.context) > most:
            raise MessageError(f"{len(chunk.context)} context frames where {most} are stacked")
        if slots > self._config.replay.capacity:
            raise MessageError(f"{slots} frames do not fit the ring")
        if (chunk.actions >= len(KEYS_OF_ACTION)).any():
            raise MessageError(f"actions should be less than {len(KEYS_OF_ACTION)}")

    def _place(self, key: ChunkKey, chunk: Chunk) -> Placement:
        """Make room for the chunk, and say where it goes."""
        ring, ledger = self._ring, self._ledger
        self._make_room(len(chunk.context) + len(chunk) + len(chunk.final_frames))
        before = ledger.neighbour(key, -1)
        previous, context = -1, len(chunk.context)
        goes_on = context > 0 or self._config.play.history == 1
        if goes_on and before is not None and ring.is_open(before.placement):
            last = before.placement.last
            if ring.can_lend(last):
                previous, context = last, 0
        return Placement(ring.head, context, len(chunk), len(chunk.final_frames), previous)

    def _make_room(self, count: int) -> None:
        """Evict the oldest chunks until ``count`` slots are free."""
        ring, ledger = self._ring, self._ledger
        least = ring.head + count - self._config.replay.capacity
        tail = ring.tail
        for record in ledger.chunks:
            if tail >= least:
                break
            tail = record.placement.end
        if tail == ring.tail:
            return
        # First of all: the slots below are about to be overwritten, and a successor of this
        # process must not take them for what they were.
        self._journal.append(tail_entry(tail))
        with self._state:
            admitted = self._sampler.admitted
            touched = set(range(ring.tail, tail))
            ring.tail = tail
            for record in ledger.evict(tail):
                touched |= self._steps_beside(record.key)
            ids = np.array(sorted(touched), np.int64)
            ids = ids[admitted.contains(ids)]
            self._sampler.remove(ids[~ring.is_complete(ids)])

    def _steps_beside(self, key: ChunkKey) -> set[int]:
        """Steps whose return, or whose stack, may reach into the chunk."""
        n_step, history = self._config.learning.n_step, self._config.play.history
        return self._ledger.steps_beside(key, n_step, history - 1)

    def _facts(self, chunk: Chunk) -> ChunkFacts:
        begun = self._drawn // self._config.learning.batch_size
        return ChunkFacts(
            index=self._ledger.accepted,
            agent_steps=self._ledger.agent_steps + len(chunk),
            steps=len(chunk),
            actor=chunk.actor,
            epsilon=chunk.epsilon,
            weights_version=chunk.weights_version,
            staleness=max(begun - chunk.weights_version, 0),
            valid=int(np.count_nonzero(chunk.valid)),
            matched=int(np.count_nonzero(chunk.matched)),
            games=chunk.games,
        )

    def _admit(self, record: ChunkRecord, facts: ChunkFacts) -> None:
        ring, ledger, place = self._ring, self._ledger, record.placement
        ledger.accept(record, facts)
        ring.head = place.end
        ring.link(place)
        before = ledger.neighbour(record.key, -1)
        if before is not None:
            self._join(before, record)
        self._join(record, ledger.neighbour(record.key, 1))
        touched = self._steps_beside(record.key) | set(range(place.first, place.last + 1))
        ids = np.array(sorted(touched), np.int64)
        ids = ids[~self._sampler.admitted.contains(ids)]
        self._sampler.add(ids[ring.is_complete(ids)])

    def _join(self, record: ChunkRecord, after: ChunkRecord | None) -> None:
        """Let ``after``, if it goes on with the episode at the end of ``record``, complete it."""
        if after is None or not self._ring.is_open(record.placement):
            return
        if after.placement.context or after.placement.previous >= 0:
            self._ring.join(record.placement.last, after.placement.first)

    def _ack(self, status: Literal["stored", "duplicate", "knock"]) -> Ack:
        return Ack(
            status,
            hold=self._should_hold(),
            finished=self._finished,
            agent_steps=self._ledger.agent_steps,
            weights_version=self.weights_version,
        )

    def _should_hold(self) -> bool:
        return self._limiter.should_hold(self._ledger.agent_steps, self._drawn)

    def await_release(self, timeout: float) -> Ack:
        """Answer a held actor: when it may go on or leave, or after ``timeout`` seconds."""
        with self._state:
            self._state.wait_for(
                lambda: self._closed or self._finished or not self._should_hold(), timeout
            )
            return self._ack("knock")

    def sample(self, drawn: int, timeout: float) -> Batch | None:
        """See `Replay.sample`."""
        with self._state:
            released = drawn > self._drawn and self._should_hold()
            self._drawn = drawn
            self._finished = False  # whoever draws goes on, as after a resume with more steps
            if released and not self._should_hold():
                self._state.notify_all()
            self._state.wait_for(lambda: self._closed or self._may_sample(drawn), timeout)
            if self._closed or not self._may_sample(drawn):
                return None
        for _ in range(_HURRIED_READS):
            with self._state:
                ids, weights = self._draw()
            batch = self._ring.read(ids, weights)
            if batch is not None:
                return batch
        with self._state:  # the ring turns faster than it is read: let it wait this once
            return self._ring.read(*self._draw())

    def _draw(self) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        return self._sampler.draw(self._rng, self._config.learning.batch_size)

    def _may_sample(self, drawn: int) -> bool:
        inserted = self._ledger.agent_steps
        return len(self._sampler.admitted) > 0 and self._limiter.may_sample(inserted, drawn)

    def update_priorities(self, ids: NDArray[np.int64], priorities: NDArray[np.float32]) -> None:
        """See `Replay.update_priorities`.

        Raises:
            MessageError: a priority is negative or not finite, as after a diverged update.
        """
        if not (np.isfinite(priorities).all() and (priorities >= 0).all() and (ids >= 0).all()):
            raise MessageError("priorities should be finite and not negative, ids too")
        with self._state:
            self._sampler.update(ids, priorities.astype(np.float64))

    def held_out(self, count: int) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """See `Replay.held_out`."""
        with self._state:
            ids = self._rng.permutation(self._sampler.admitted.ids)
            ids = ids[self._ring.all_seen(ids)][:count]
            return self._ring.states(ids)

    def progress(self, since: int, *, finished: bool = False) -> Progress:
        """See `Replay.progress`."""
        resident, private = footprint()
        with self._state:
            if finished and not self._finished:
                self._finished = True
                self._state.notify_all()
            ledger = self._ledger
            return Progress(
                agent_steps=ledger.agent_steps,
                stored=ledger.stored,
                samplable=len(self._sampler.admitted),
                accepted=ledger.accepted,
                duplicates=ledger.duplicates,
                refused=ledger.refused,
                hold=self._should_hold(),
                resident_bytes=resident,
                private_bytes=private,
                file_bytes=self._columns.file_bytes,
                facts=ledger.facts_since(since),
            )

    def close(self) -> None:
        """Let waiting calls return, and close the files; what was stored stays."""
        with self._state:
            self._closed = True
            self._state.notify_all()
        with self._writer:
            self._journal.close()
            self._columns.close()
