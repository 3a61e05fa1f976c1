"""`RemoteReplay`: the replay of another process, for a learner that is its client."""

import threading
import time

import numpy as np
import zenoh
from numpy.typing import NDArray

from common.bus import RunKeys
from common.config import RunConfig
from common.errors import InputError, MessageError
from replay import messages
from replay.batch import Batch
from replay.facts import Progress, decode_progress

_PATIENCE = 5.0
"""Seconds for an answer, before the server counts as away."""
_PAUSE = 0.2


class RemoteReplay:
    """Implements `replay.interface.Replay` by queries.

    A server that is away is waited for: `sample` answers None, as when actors are behind,
    `held_out` and `progress` return when it is back, and priorities are dropped, for they are
    only advice.
    """

    def __init__(self, session: zenoh.Session, keys: RunKeys, config: RunConfig) -> None:
        self._session = session
        self._keys = keys
        self._history = config.play.history
        self._closed = threading.Event()

    def sample(self, drawn: int, timeout: float) -> Batch | None:
        """See `Replay.sample`.

        Raises:
            MessageError: the server refuses the question, or answers with something else.
        """
        ends = time.monotonic() + timeout
        while not self._closed.is_set():
            left = max(ends - time.monotonic(), 0.0)
            answer = self._ask(self._keys.sample, messages.encode_sample_request(drawn, left))
            if answer is None:
                self._closed.wait(min(_PAUSE, left))
            elif batch := messages.decode_sample_reply(answer):
                if batch.s_tm1.shape[1] != self._history:
                    raise MessageError(f"states of {batch.s_tm1.shape[1]} frames")
                return batch
            if time.monotonic() >= ends:
                break
        return None

    def update_priorities(self, ids: NDArray[np.int64], priorities: NDArray[np.float32]) -> None:
        """See `Replay.update_priorities`."""
        self._ask(self._keys.priorities, messages.encode_priorities(ids, priorities))

    def held_out(self, count: int) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """See `Replay.held_out`.

        Raises:
            InputError: `close` was called while the server was away.
            MessageError: so many states do not fit a message.
        """
        answer = self._insist(self._keys.held_out, messages.encode_held_out_request(count))
        return messages.decode_held_out_reply(answer)

    def progress(self, since: int, *, finished: bool | None = None) -> Progress:
        """See `Replay.progress`.

        Raises:
            InputError: `close` was called while the server was away.
        """
        request = messages.encode_progress_request(since, finished)
        return decode_progress(self._insist(self._keys.progress, request))

    def close(self) -> None:
        """Stop waiting for the server; the session stays open."""
        self._closed.set()

    def _insist(self, key: str, request: bytes) -> bytes:
        while (answer := self._ask(key, request)) is None:
            if self._closed.wait(_PAUSE):
                raise InputError("the replay did not answer before this process stopped.")
        return answer

    def _ask(self, key: str, request: bytes) -> bytes | None:
        """The answer; None if there is no server, or none that answers in time."""
        replies = self._session.get(
            key,
            payload=request,
            timeout=_PATIENCE,
            consolidation=zenoh.ConsolidationMode.NONE,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        refusal = None
        for reply in replies:
            if reply.ok is not None:
                return reply.ok.payload.to_bytes()
            if reply.err is not None:
                refusal = reply.err.payload.to_bytes().decode(errors="replace")
        if refusal is None or refusal == "Timeout":
            return None
        raise MessageError(f"the replay refused a question: {refusal}")
