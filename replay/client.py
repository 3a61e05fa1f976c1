"""`RemoteReplay`: the replay of another process, for a learner that is its client."""

import threading
import time

import numpy as np
import zenoh
from numpy.typing import NDArray

from common.errors import InputError, MessageError
from common.protocol.run_keys import RunKeys
from common.run.config import RunConfig
from replay.batch import Batch, SharedBatch
from replay.chunk_statistics import Progress
from replay.messages import (
    HeldOutRequest,
    HeldOutStates,
    Priorities,
    ProgressRequest,
    SampleRequest,
)
from replay.questions import PendingQueries

AHEAD = 3
"""Minibatches that are asked for before they are wanted: enough to keep both sides at work, few
enough to stay fresh."""
MOST_ADVICE = 64
"""Messages of priorities that may be unanswered."""
_PAUSE = 0.2


class RemoteReplay:
    """Implements `replay.interface.Replay` by queries.

    A server that is away is waited for: `sample` answers None, as when actors are behind, and
    `held_out` and `progress` return when it is back.

    Args:
        ahead: minibatches to ask for before they are wanted; 0 asks for one at a time.
    """

    def __init__(
        self, session: zenoh.Session, keys: RunKeys, config: RunConfig, ahead: int = AHEAD
    ) -> None:
        self._session = session
        self._keys = keys
        self._frame_stack = config.play.frame_stack
        self._batch_size = config.learning.batch_size
        self._ahead = ahead
        self._going_well = False
        self._drawing = threading.Lock()
        self._draws = PendingQueries(session, keys.sample)
        self._advice = PendingQueries(session, keys.priorities)
        self._closed = threading.Event()

    def sample(self, drawn: int, timeout: float) -> Batch | None:
        """See `Replay.sample`.

        While batches come, `ahead` more are asked for, each with the number that will have been
        drawn when all before it have come. The limiter so never lets go of more than it should;
        and after an answer without a batch, one at a time is asked for, with the true number.

        Raises:
            MessageError: the server refuses the question, or answers with something else.
        """
        ends = time.monotonic() + timeout
        with self._drawing:
            while not self._closed.is_set():
                left = max(ends - time.monotonic(), 0.0)
                self._ask_for_batches(drawn, left)
                try:
                    answer = self._draws.take(left)
                except TimeoutError:
                    return None
                batch = SharedBatch.decode(answer) if answer else None
                self._going_well = batch is not None
                if batch is not None:
                    if batch.stacks.shape[2] != self._frame_stack:
                        raise MessageError(f"states of {batch.stacks.shape[2]} frames")
                    return batch.whole()
                if answer is None:
                    self._closed.wait(min(_PAUSE, left))
                if time.monotonic() >= ends:
                    break
            return None

    def _ask_for_batches(self, drawn: int, timeout: float) -> None:
        under_way = self._draws.open
        wanted = 1 + self._ahead if self._going_well else 1
        for place in range(under_way, wanted):
            request = SampleRequest(drawn + place * self._batch_size, timeout)
            self._draws.ask(request.encode())

    def update_priorities(self, ids: NDArray[np.int64], priorities: NDArray[np.float32]) -> None:
        """See `Replay.update_priorities`.

        It returns at once. Messages arrive in order; one is lost if the server is away, or if
        `MOST_ADVICE` earlier ones are unanswered because it cannot keep up. That loses nothing
        but freshness: steps keep the priorities that they have, and a step that is drawn again is
        given new ones.

        Raises:
            MessageError: the server refused an earlier message.
        """
        self._advice.clear()
        if self._advice.open < MOST_ADVICE:
            self._advice.ask(Priorities(ids, priorities).encode())

    def held_out(self, count: int) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """See `Replay.held_out`.

        Raises:
            InputError: `close` was called while the server was away.
            MessageError: so many states do not fit a message.
        """
        answer = self._insist(self._keys.held_out, HeldOutRequest(count).encode())
        held = HeldOutStates.decode(answer)
        return held.frames, held.vectors

    def progress(self, since: int, *, finished: bool | None = None) -> Progress:
        """See `Replay.progress`.

        Raises:
            InputError: `close` was called while the server was away.
        """
        request = ProgressRequest(since, finished).encode()
        return Progress.decode(self._insist(self._keys.progress, request))

    def close(self) -> None:
        """Stop waiting for the server; the session stays open."""
        self._closed.set()
        self._draws.close()

    def _insist(self, key: str, request: bytes) -> bytes:
        while (answer := self._ask(key, request)) is None:
            if self._closed.wait(_PAUSE):
                raise InputError("the replay did not answer before this process stopped.")
        return answer

    def _ask(self, key: str, request: bytes) -> bytes | None:
        """The answer; None if there is no server, or none that answers in time."""
        question = PendingQueries(self._session, key)
        question.ask(request)
        return question.take()
