"""`RemoteReplay`: the replay in another process, for a learner that is its client."""

import logging
import threading
import time
from collections import deque
from concurrent.futures import Future, wait
from contextlib import suppress
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from common.checked import MAX_COUNT
from common.errors import InputError, MessageError
from common.process.service_manager import alive
from common.protocol.message import Message
from common.protocol.run_keys import RunKeys
from common.settings.config import RunConfig
from common.transport.interface import Envelope, Requester, Transport, Unanswered
from replay.batch import Batch, SharedBatch
from replay.chunk_statistics import ReplayProgress
from replay.messages import (
    MAX_PRIORITIES,
    HeldOutRequest,
    HeldOutStates,
    ProgressRequest,
    SampleRequest,
)

AHEAD = 3
"""Number of minibatches that are requested in advance: enough to keep both sides busy, few enough
to stay fresh."""
MAX_PRIORITY_UPDATES = 64
"""Maximum number of calls of `RemoteReplay.update_priorities` that wait for the next request."""
DEADLINE = 5.0
"""Seconds without an answer after which the server counts as away."""
LONG_DEADLINE = 60.0
"""The same for answers that a disk or tens of megabytes hold up: `Replay.sync`, and `held_out`."""
_PAUSE_SECONDS = 0.2
_NO_IDS, _NO_PRIORITIES = np.zeros(0, np.int64), np.zeros(0, np.float32)
_log = logging.getLogger(__name__)
_Answer = TypeVar("_Answer", bound=Message)


class RemoteReplay:
    """Implements `replay.interface.Replay` by requests.

    If the server is away, the client waits for it. `sample` returns None, as when actors are
    behind; `held_out` and `progress` log it once, and return when the server is back.
    """

    def __init__(self, transport: Transport, keys: RunKeys, config: RunConfig) -> None:
        self.run_id = keys.run_id
        self._frame_stack = config.play.frame_stack
        self._batch_size = config.learning.batch_size
        self._going_well = False
        self._drawing = threading.Lock()
        self._sample, self._progress = (
            transport.requester(key, DEADLINE) for key in (keys.sample, keys.progress)
        )
        self._held_out, self._syncs = (
            transport.requester(key, LONG_DEADLINE) for key in (keys.held_out, keys.progress)
        )
        self._last = transport.requester(keys.progress, DEADLINE)
        """Only the transport closes it, because a checkpoint comes after a stop has closed the
        others."""
        self._draws: deque[Future[Envelope]] = deque()  # oldest first
        self._updates: deque[tuple[NDArray[np.int64], NDArray[np.float32]]] = deque(
            maxlen=MAX_PRIORITY_UPDATES
        )
        """Steps and their new priorities that no request has told yet, oldest first."""
        self._closed = threading.Event()

    def sample(self, drawn: int, timeout: float) -> Batch | None:
        """See `Replay.sample`.

        While batches come, `AHEAD` more are requested, each with the number of steps that will have
        been drawn when all earlier batches have come. So the limiter never releases more than it
        should. After an answer without a batch, one batch at a time is requested, with the true
        number. Each request tells the priorities that are new since the one before. Raises
        InputError if the server refuses the request, or sends a malformed answer.
        """
        ends = time.monotonic() + timeout
        with self._drawing:
            while not self._closed.is_set():
                left = max(ends - time.monotonic(), 0.0)
                for place in range(len(self._draws), 1 + AHEAD if self._going_well else 1):
                    due = drawn + place * self._batch_size
                    request = SampleRequest(due, left, *self._take_updates())
                    self._draws.append(self._sample.request(request.encode()))
                if not wait([self._draws[0]], left).done:
                    return None
                answer = _answer(self._draws.popleft())
                batch = _decoded(SharedBatch, answer) if answer else None
                self._going_well = batch is not None
                if batch is not None:
                    if batch.stacks.shape[2] != self._frame_stack:
                        raise _misfit(f"it gave states of {batch.stacks.shape[2]} frames")
                    return batch.whole()
                if answer is None:
                    self._closed.wait(min(_PAUSE_SECONDS, left))
                if time.monotonic() >= ends:
                    break
            return None

    def update_priorities(self, ids: NDArray[np.int64], priorities: NDArray[np.float32]) -> None:
        """See `Replay.update_priorities`.

        It returns at once: the next request for a minibatch tells them, after those that are under
        way, or else `close`. They are lost if the server is away then, or if `MAX_PRIORITY_UPDATES`
        calls or `MAX_PRIORITIES` steps are newer. That costs only freshness: steps keep their
        priorities, or stay to be drawn, and a step that is drawn again gets a new one.
        """
        self._updates.append((ids, priorities))

    def _take_updates(self) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Returns the ids of all steps with a new priority, and their priorities."""
        told: list[tuple[NDArray[np.int64], NDArray[np.float32]]] = [(_NO_IDS, _NO_PRIORITIES)]
        with suppress(IndexError):  # `close` may take some at the same time
            while True:
                told.append(self._updates.popleft())
        ids, priorities = zip(*told, strict=True)
        newest = slice(-MAX_PRIORITIES, None)
        return np.concatenate(ids)[newest], np.concatenate(priorities)[newest]

    def held_out(
        self, count: int, newest: int | None = None
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """See `Replay.held_out`. Raises InputError if `close` was called while the server was away,
        or if so many states do not fit into a message."""
        request = HeldOutRequest(count, newest).encode()
        held = _decoded(HeldOutStates, self._until_answered(self._held_out, request))
        return held.frames, held.vectors

    def progress(self, since: int = MAX_COUNT, *, goal: int | None = None) -> ReplayProgress:
        """See `Replay.progress`; works after `close` too, unless the server is away. Raises
        InputError if `close` was called while the server was away, or if it now serves another
        run."""
        requester = self._last if self._closed.is_set() else self._progress
        request = ProgressRequest(since, goal).encode()
        found = _decoded(ReplayProgress, self._until_answered(requester, request))
        if found.run_id != self.run_id:
            raise InputError(
                "the replay serves another run under this name now: give it back the run's folder "
                "and start it with --resume, or begin another run."
            )
        return found

    def drain(self) -> None:
        """See `Replay.drain`; works after `close` too."""
        _answer(self._last.request(ProgressRequest(drain=True).encode()))

    def sync(self) -> None:
        """See `Replay.sync`; works after `close` too, but then does not wait longer for a slow
        disk. Raises InputError if the replay's disk refuses."""
        requester = self._last if self._closed.is_set() else self._syncs
        future = requester.request(ProgressRequest(durable=True).encode())
        try:
            future.result()
        except Unanswered:
            pass  # it is away, as the interface allows
        except MessageError as error:
            raise InputError(
                f"the replay's disk does not keep its steps ({error}), so no checkpoint may count "
                "them: repair that disk, start the replay again with --resume, then the learner."
            ) from None

    def close(self) -> None:
        """Stops waiting for the server, and tells it the last priorities; the transport stays
        open."""
        self._closed.set()
        if self._updates:
            self._sample.request(SampleRequest(None, 0.0, *self._take_updates()).encode())
        for requester in (self._sample, self._progress, self._held_out, self._syncs):
            requester.close()

    def _until_answered(self, requester: Requester, request: bytes) -> bytes:
        away = False
        while (answer := _answer(requester.request(request))) is None:
            if self._closed.is_set():
                raise InputError("the replay did not answer before this process stopped.")
            if not away:
                _log.warning("the replay does not answer: training waits for it")
            away = True
            alive()
            self._closed.wait(_PAUSE_SECONDS)
        if away:
            _log.warning("the replay answers again: training continues")
        return answer


def _answer(future: Future[Envelope]) -> bytes | None:
    """Waits for the answer and returns it; None if there is no server, or none that answers in
    time. Raises InputError if the server refused."""
    try:
        return future.result().payload
    except Unanswered:
        return None
    except MessageError as error:
        raise _misfit(f"it refused a request: {error}") from None


def _decoded(kind: type[_Answer], answer: bytes) -> _Answer:
    try:
        return kind.decode(answer)
    except MessageError as error:
        raise _misfit(str(error)) from None


def _misfit(why: str) -> InputError:
    return InputError(
        f"the replay and this learner do not understand each other ({why}): start both from the "
        "same version, with the same settings."
    )
