"""`ReplayServer`: a run's `ReplayBuffer` for other processes.

Each kind of request has a queue and a thread of its own, so a draw that waits for actors holds up
no insert. What nobody should have sent is refused with a sentence, counted, and forgotten.
"""

import logging
import math
import queue
import threading
import time
from contextlib import AbstractContextManager

from common.errors import MessageError
from common.process.log_lines import Seldom
from common.protocol.ack import Ack
from common.protocol.announcement import Announcement
from common.protocol.chunk import Chunk
from common.protocol.run_keys import DEMONSTRATIONS, RunKeys, name_in
from common.protocol.step_fields import FRAME_SHAPE
from common.protocol.wire import MAX_MESSAGE_BYTES, decode_version
from common.run.config import RunConfig
from common.transport.interface import Answer, Envelope, Request, Transport
from common.transport.leaky_bucket import STEPS_PER_SECOND, LeakyBucket
from replay.messages import (
    NO_BATCH,
    HeldOutRequest,
    HeldOutStates,
    Priorities,
    ProgressRequest,
    SampleRequest,
)
from replay.replay_buffer import ReplayBuffer

LONGEST_WAIT = 1.0
"""Seconds that a draw or a poll may wait at the server."""
_STEP_BYTES = math.prod(FRAME_SHAPE)
"""A step in a chunk has a frame, and hardly more."""

_log = logging.getLogger(__name__)
_refusals = _log.getChild("refusals")
_refusals.addFilter(Seldom())


class ReplayServer(AbstractContextManager["ReplayServer"]):
    """Answers for ``memory`` until it is closed.

    Args:
        quota: steps per second that are taken of one actor.
    """

    def __init__(
        self,
        transport: Transport,
        memory: ReplayBuffer,
        config: RunConfig,
        run: str,
        quota: float = STEPS_PER_SECOND,
    ) -> None:
        self._memory = memory
        self._quota = LeakyBucket(quota)
        self._keys = keys = RunKeys(run, memory.run_id)
        self._announcement = Announcement(run, config, config.action_count, memory.run_id).encode()
        self._weights: Envelope | None = None
        self._polls: queue.SimpleQueue[tuple[float, Request] | None] = queue.SimpleQueue()
        self._poll_thread = threading.Thread(
            target=self._answer_polls, name="replay-polls", daemon=True
        )
        self._poll_thread.start()
        self._subscription = transport.subscribe(keys.weights, self._keep_weights)
        answers: dict[str, Answer] = {
            keys.config: lambda _: self._announcement,
            keys.latest_weights: self._weights_asked,
            keys.sample: self._sample,
            keys.priorities: self._priorities,
            keys.held_out: self._held_out,
            keys.progress: self._progress,
            keys.insert("*"): self._insert,
        }
        self._services = [transport.serve(key, answer) for key, answer in answers.items()]

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop answering; the memory stays open."""
        for service in self._services:
            service.close()
        self._subscription.close()
        self._polls.put(None)
        self._poll_thread.join(2 * LONGEST_WAIT)

    def _insert(self, request: Request) -> bytes | None:
        actor = name_in(request.key)
        if not self._admits(actor, request):
            request.drop()  # unanswered, it is sent again
            return None
        if not request.payload:
            self._polls.put((time.monotonic() + LONGEST_WAIT, request))
            return None
        try:
            return self._ack_of(request.payload, actor).encode()
        except MessageError as error:
            _refusals.warning("a chunk of %s was refused: %s", actor, error)
            raise

    def _admits(self, actor: str, request: Request) -> bool:
        """Whether this is within the actor's quota, as its length tells before it is decoded."""
        steps = max(len(request.payload) / _STEP_BYTES, 1.0)
        # The learner's own, which comes once.
        if actor == DEMONSTRATIONS or self._quota.admits(actor, steps):
            return True
        self._memory.over_quota += 1
        if self._quota.knows(actor):
            text = "%s sends more than --actor-quota lets it: the rest has to wait"
            _refusals.warning(text, actor)
        else:
            _refusals.warning("more new actors come than are let in at once: the rest has to wait")
        return False

    def _ack_of(self, payload: bytes, actor: str) -> Ack:
        """Stores a chunk.

        Raises:
            MessageError: it was refused, and counted so.
        """
        try:
            chunk = Chunk.decode(payload)
            if chunk.actor != actor:
                raise MessageError(f"it names {chunk.actor} as its actor")
        except MessageError:
            self._memory.refuse()
            raise
        if chunk.run_id != self._keys.run_id:
            self._memory.refuse()
            _refusals.warning("a chunk of %s was refused: it is of another run", actor)
            return self._memory.ack("refused")
        return self._memory.insert(chunk)

    def _answer_polls(self) -> None:
        """Throttled actors wait here, each at most `LONGEST_WAIT`, while inserts go on.

        Of those that wait the first is due first, and a release lets them all go.
        """
        while (poll := self._polls.get()) is not None:
            due, request = poll
            left = max(due - time.monotonic(), 0.0)
            request.reply(self._memory.await_release(left).encode())

    def _sample(self, request: Request) -> bytes:
        asked = SampleRequest.decode(request.payload)
        batch = self._memory.sample_shared(asked.drawn, min(asked.timeout, LONGEST_WAIT))
        return NO_BATCH if batch is None else batch.encode()

    def _priorities(self, request: Request) -> bytes:
        advice = Priorities.decode(request.payload)
        self._memory.update_priorities(advice.ids, advice.priorities)
        return b""

    def _held_out(self, request: Request) -> bytes:
        asked = HeldOutRequest.decode(request.payload)
        return HeldOutStates(*self._memory.held_out(asked.count, asked.newest)).encode()

    def _progress(self, request: Request) -> bytes:
        asked = ProgressRequest.decode(request.payload)
        if asked.durable:
            self._memory.sync()
        return self._memory.progress(asked.since, finished=asked.finished).encode()

    def _weights_asked(self, _: Request) -> Envelope:
        if self._weights is None:
            raise MessageError("there are no weights yet")
        return self._weights

    def _keep_weights(self, message: Envelope) -> None:
        size = len(message.payload)
        try:
            version, _ = decode_version(message.attachment, self._keys.run_id)
            if size > MAX_MESSAGE_BYTES:
                raise MessageError(f"more than {MAX_MESSAGE_BYTES} bytes")
        except MessageError as error:
            _log.warning("weights of %d bytes were passed over: %s", size, error)
            return
        # Not the largest but the latest: a resumed learner may start from an older version.
        self._weights = message
        self._memory.weights_version = version
