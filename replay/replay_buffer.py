"""`ReplayBuffer`: the thread-safe replay of a run in one process.

It adds the rate limiter, and waiting for it, to the `Store`. The lock is held only while the ids of
minibatches and held-out states are chosen; their frames are gathered while other threads draw and
insert (see `Ring.read`).
"""

import logging
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from common.checked import MAX_COUNT
from common.process.footprint import footprint
from common.protocol.ack import Ack
from common.protocol.chunk import Chunk
from common.protocol.run_keys import run_id_of
from common.settings.config import RunConfig
from common.settings.stored_config import to_json
from replay.batch import Batch, SharedBatch
from replay.chunk_statistics import ReplayProgress
from replay.limiter import RateLimiter
from replay.store import Store
from replay.turns import Turns

_HURRIED_READS = 3
"""Number of reads beside writers before one that keeps them out."""
_log = logging.getLogger(__name__)
_Found = TypeVar("_Found")


class ReplayBuffer:
    """The replay buffer of one run; implements `replay.interface.Replay`."""

    def __init__(self, config: RunConfig, folder: Path) -> None:
        """Opens the replay in ``folder``, or creates it. Raises InputError if there is no space; if
        the replay there has other sizes, is damaged or in use; or for an unknown environment or
        game."""
        self.weights_version = 0
        """Version of the newest weights, which each acknowledgement carries."""
        self.over_quota = 0
        """Number of actors' messages that must be sent again, over quota or in spite of the
        throttle, since this process began."""
        self.shut_out = 0
        """Number of connections by processes that this hub does not admit, since this process
        began."""
        self.draws = False
        """Whether a learner has asked for a minibatch since this process began."""
        self._batch_size = config.learning.batch_size
        self._difficulty_after = config.difficulty_after
        self.released: Callable[[], None] = lambda: None
        """Called under a lock when throttled actors may go on or leave; must be brief."""
        self._limiter = RateLimiter.of(config)
        self._turns = Turns(config.stream.chunk_steps, config.stream.window)
        self._state = threading.Condition()
        self._store = Store(config, folder, self._state)
        self.run_id = run_id_of(self._store.uuid, to_json(config))
        """See `common.run.announcement.Announcement`."""
        # A different sequence after each start, or a resumed run would repeat the same draws.
        self._rng = np.random.default_rng([config.seed, self._store.index.accepted])
        self._closed = False
        self._goal = MAX_COUNT
        self._drains = False
        self._drawn = 0

    def admits(self, actor: str) -> bool:
        """Whether a chunk of ``actor`` is accepted now; see `Turns` for throttled actors."""
        with self._state:
            ends = self._finished or self._drains
            return ends or not self._should_throttle() or self._turns.admits(actor)

    def ignores_throttle(self, actor: str) -> bool:
        """Whether ``actor`` keeps sending although `admits` refuses it."""
        with self._state:
            return self._turns.ignores_throttle(actor)

    def insert(self, chunk: Chunk) -> Ack:
        """Stores ``chunk``, unless it was received before. It never waits for the learner.

        Raises:
            MessageError: the chunk does not fit this run, and is counted as refused.
            OSError: the files could not be written; the chunk may be sent again.
        """
        begun = self._drawn // self._batch_size
        new = self._store.insert(chunk, staleness=max(begun - chunk.weights_version, 0))
        with self._state:
            throttle = self._should_throttle()
            if new:
                self._turns.charge(chunk.actor, len(chunk), still_open=not throttle)
            if self._finished:
                self.released()
            return self.ack("stored" if new else "duplicate", throttle)

    def refuse(self) -> None:
        """Counts a chunk that could not be decoded, or belongs to another run."""
        self._store.count_refused()

    def poll(self, actor: str) -> Ack:
        """Returns the answer to a throttled ``actor`` that asks to go on. An actor that asked
        before the limiter opened may go on, even if others have closed it again."""
        with self._state:
            throttle = self._should_throttle() and not self._turns.has_turn(actor)
            if not throttle:
                self._turns.let_go(actor)
            return self.ack("poll", throttle)

    def ack(
        self,
        status: Literal["stored", "duplicate", "poll", "refused"],
        throttle: bool | None = None,
    ) -> Ack:
        """Returns an acknowledgement with the present state. If ``throttle`` is None, the limiter
        decides."""
        return Ack(
            status,
            throttle=self._should_throttle() if throttle is None else throttle,
            finished=self._finished,
            agent_steps=self._store.index.agent_steps,
            difficulty=self._difficulty(),
            weights_version=self.weights_version,
            run_id=self.run_id,
        )

    @property
    def _finished(self) -> bool:
        return self._store.index.agent_steps >= self._goal

    def _should_throttle(self) -> bool:
        return self._limiter.should_throttle(self._store.index.agent_steps, self._drawn)

    def _difficulty(self) -> float:
        return self._difficulty_after(self._store.index.curriculum_steps)

    def sample(self, drawn: int, timeout: float) -> Batch | None:
        return self._sample(drawn, timeout, self._store.ring.read)

    def sample_shared(self, drawn: int, timeout: float) -> SharedBatch | None:
        """Returns what `sample` returns, with each frame once, to be sent to another process."""
        return self._sample(drawn, timeout, self._store.ring.read_shared)

    def _sample(
        self,
        drawn: int,
        timeout: float,
        read: Callable[[NDArray[np.int64], NDArray[np.float32]], _Found | None],
    ) -> _Found | None:
        self.draws = True
        with self._state:
            # The learner drew the steps from which it learned the newest weights, so a smaller
            # count is not from it. (A resumed learner first publishes its older weights.)
            if drawn >= self.weights_version * self._batch_size:
                throttled = self._should_throttle()
                self._drains = False
                self._drawn = drawn
                if throttled and not self._should_throttle():
                    self._turns.open()
                    self.released()
            self._state.wait_for(lambda: self._closed or self._may_sample(drawn), timeout)
        return self._gather(partial(self._draw, drawn), read)

    def _gather(
        self, choose: Callable[[], tuple[Any, ...] | None], read: Callable[..., _Found | None]
    ) -> _Found | None:
        """Returns the result of ``read`` for what ``choose`` returns under the lock; None if that
        is None."""
        for _ in range(_HURRIED_READS):
            with self._state:
                chosen = choose()
            if chosen is None:
                return None
            if (found := read(*chosen)) is not None:
                return found
        with self._state:  # the ring turns faster than it is read, so keep writers out this once
            chosen = choose()
            return None if chosen is None else read(*chosen)

    def _draw(self, drawn: int) -> tuple[NDArray[np.int64], NDArray[np.float32]] | None:
        # Asked at each try, because an insert may have evicted all that could be drawn.
        if not self._may_sample(drawn):
            return None
        return self._store.sampler.draw(self._rng, self._batch_size)

    def _may_sample(self, drawn: int) -> bool:
        inserted = self._store.index.agent_steps
        return len(self._store.sampler) > 0 and self._limiter.may_sample(inserted, drawn)

    def update_priorities(self, ids: NDArray[np.int64], priorities: NDArray[np.float32]) -> None:
        """See `Replay.update_priorities`."""
        finite = np.isfinite(priorities)
        with self._state:
            self._store.sampler.update(ids[finite], priorities[finite].astype(np.float64))
            gone, actors = self._store.quarantine(ids[~finite])
        if actors:
            text = "steps %s of %s are not drawn again: their loss is not finite"
            _log.warning(text, ", ".join(map(str, gone)), ", ".join(actors))

    def held_out(
        self, count: int, newest: int | None = None
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        ring = self._store.ring

        def choose() -> tuple[NDArray[np.int64]]:
            ids = self._store.sampler.ids
            if newest is not None:
                ids = ids[ids >= ring.head - newest]
            return (self._rng.permutation(ids),)

        found = self._gather(choose, lambda ids: ring.states(ids[ring.all_seen(ids)][:count]))
        assert found is not None
        return found

    def progress(self, since: int = MAX_COUNT, *, goal: int | None = None) -> ReplayProgress:
        resident, private = footprint()
        file_bytes = self._store.columns.file_bytes  # without the lock, as the disk may be slow
        with self._state:
            if goal is not None and goal != self._goal:
                self._goal = goal
                self.released()
            index = self._store.index
            return ReplayProgress(
                agent_steps=index.agent_steps,
                stored=index.stored,
                samplable=len(self._store.sampler),
                accepted=index.accepted,
                duplicates=index.duplicates,
                refused=index.refused,
                throttle=self._should_throttle(),
                resident_bytes=resident,
                private_bytes=private,
                file_bytes=file_bytes,
                statistics=index.statistics_since(since),
                run_id=self.run_id,
                over_quota=self.over_quota,
                shut_out=self.shut_out,
                difficulty=self._difficulty(),
                failed=self._store.sampler.failed,
            )

    def drain(self) -> None:
        with self._state:
            self._drains = True

    def sync(self) -> None:
        self._store.sync()

    def close(self) -> None:
        """Releases waiting calls and closes the files, which keep what was stored."""
        with self._state:
            self._closed = True
            self._state.notify_all()
        self._store.close()
