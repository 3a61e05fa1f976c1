"""`ReplayServer`: serves a run's `ReplayBuffer` to other processes.

Each kind of request has its own queue and thread, so a draw that waits for actors delays no insert.
An invalid message is refused with a sentence, counted, and dropped.
"""

import logging
import queue
import threading
import time
from contextlib import AbstractContextManager

from common.errors import MessageError
from common.process.log_lines import Seldom
from common.protocol.ack import Ack
from common.protocol.chunk import MAX_CHUNK_BYTES, Chunk
from common.protocol.run_keys import DEMONSTRATIONS, RunKeys, name_in
from common.protocol.step_fields import FRAME_BYTES
from common.protocol.wire import MAX_MESSAGE_BYTES, decode_version
from common.run.announcement import Announcement
from common.settings.config import RunConfig
from common.transport.interface import Answer, Envelope, Request, Transport
from common.transport.leaky_bucket import ACTOR_QUOTA, LeakyBucket
from replay.messages import (
    NO_BATCH,
    HeldOutRequest,
    HeldOutStates,
    ProgressRequest,
    SampleRequest,
)
from replay.replay_buffer import ReplayBuffer

LONGEST_WAIT = 1.0
"""Maximum seconds that a draw or a poll waits at the server."""
_POLL_STEPS = 16
"""Steps of the quota that a poll costs; a well-behaved actor polls once per chunk, or after
`LONGEST_WAIT`."""

_log = logging.getLogger(__name__)
_log.addFilter(Seldom())


class ReplayServer(AbstractContextManager["ReplayServer"]):
    """Answers requests to ``buffer`` until it is closed, and accepts at most ``quota`` steps per
    second from each actor."""

    def __init__(
        self,
        transport: Transport,
        buffer: ReplayBuffer,
        config: RunConfig,
        run: str,
        quota: float = ACTOR_QUOTA,
    ) -> None:
        self._transport = transport
        self._buffer = buffer
        self._quota = LeakyBucket(quota)
        self._keys = keys = RunKeys(run, buffer.run_id)
        self._announcement = Announcement(run, config, config.action_count, buffer.run_id).encode()
        self._weights: Envelope | None = None
        self._polls: queue.SimpleQueue[Request | None] = queue.SimpleQueue()
        """Polls to be answered. None means that waiting actors may go on or leave, or that the
        server closes."""
        self._closed = False
        buffer.released = lambda: self._polls.put(None)
        self._poll_thread = threading.Thread(
            target=self._answer_polls, name="replay-polls", daemon=True
        )
        self._poll_thread.start()
        self._subscription = transport.subscribe(keys.weights, self._keep_weights)
        answers: dict[str, Answer] = {
            keys.config: lambda _: self._announcement,
            keys.latest_weights: self._weights_asked,
            keys.sample: self._sample,
            keys.held_out: self._held_out,
            keys.progress: self._progress,
            keys.insert("*"): self._insert,
        }
        self._shut_out = transport.watch_shut_out(self._count_shut_out)
        self._services = [transport.serve(key, answer) for key, answer in answers.items()]

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stops answering; the buffer stays open."""
        for service in self._services:
            service.close()
        self._subscription.close()
        self._shut_out.close()
        self._buffer.released = lambda: None
        self._closed = True
        self._polls.put(None)
        self._poll_thread.join(2 * LONGEST_WAIT)

    def _count_shut_out(self, name: str, address: str) -> None:
        self._buffer.shut_out += 1
        text = "the hub does not admit the certificate of %s: connections from %s are ignored"
        _log.warning(text, name, address)

    def _insert(self, request: Request) -> bytes | None:
        actor = name_in(request.key)
        if not self._admits(actor, request):
            request.drop()  # the actor sends it again
            return None
        if not (payload := request.payload):
            self._polls.put(request)
            return None
        size = MAX_CHUNK_BYTES  # of a malformed one, which may take as long to decompress
        try:
            chunk = self._chunk_in(payload, actor)
            size = chunk.nbytes
            return self._ack_of(chunk).encode()
        except MessageError as error:
            _log.warning("a chunk of %s was refused: %s", actor, error)
            raise
        finally:
            self._quota.charge(actor, size / FRAME_BYTES)

    def _admits(self, actor: str, request: Request) -> bool:
        """Whether the request is within the actor's turn and quota, judged before it is read. A
        chunk then counts as one step; `_insert` charges the rest."""
        if actor == DEMONSTRATIONS and not self._buffer.draws:  # the learner's, at the beginning
            return True
        known = self._quota.knows(actor)
        steps = 1.0 if request.size else _POLL_STEPS
        if request.size and known and not self._buffer.admits(actor):
            if not self._buffer.ignores_throttle(actor):
                return False
            text = f"{actor} keeps sending although it is throttled"
        elif self._quota.admits(actor, steps):
            return True
        elif known:
            text = f"{actor} sends more than --actor-quota allows"
        else:
            text = "more new actors come than are admitted at once"
        self._buffer.over_quota += 1
        self._transport.note_over_quota(actor)
        _log.warning("%s: the rest has to wait", text)
        return False

    def _chunk_in(self, payload: bytes, actor: str) -> Chunk:
        """Returns the chunk in ``payload``. Raises MessageError, and counts it as refused, if it
        is malformed."""
        try:
            chunk = Chunk.decode(payload)
            if chunk.actor != actor:
                raise MessageError(f"it names {chunk.actor} as its actor")
        except MessageError:
            self._buffer.refuse()
            raise
        return chunk

    def _ack_of(self, chunk: Chunk) -> Ack:
        """Stores a chunk, and returns the answer. Raises MessageError, and counts the chunk as
        refused, if it does not fit this run."""
        if chunk.run_id != self._keys.run_id:
            self._buffer.refuse()
            _log.warning("a chunk of %s was refused: it is of another run", chunk.actor)
            return self._buffer.ack("refused")
        return self._buffer.insert(chunk)

    def _answer_polls(self) -> None:
        """Lets throttled actors wait here, each at most `LONGEST_WAIT`, while inserts go on."""
        waiting: dict[str, tuple[float, Request]] = {}
        """By actor, its poll and the time at which that is answered in any case, next one first."""

        def answer(actor: str, *, in_any_case: bool = False) -> None:
            told = self._buffer.poll(actor)
            if in_any_case or told.finished or not told.throttle:
                waiting.pop(actor)[1].reply(told.encode())

        while True:
            for actor, (due, _) in tuple(waiting.items()):
                left = due - time.monotonic()
                if left > 0:
                    break
                answer(actor, in_any_case=True)
            try:
                request = self._polls.get(timeout=left if waiting else None)
            except queue.Empty:
                continue
            if request is None:
                if self._closed:
                    return
                for actor in tuple(waiting):
                    answer(actor)
            else:
                actor = name_in(request.key)
                if actor in waiting:  # one poll per actor, however often it asks
                    answer(actor, in_any_case=True)
                waiting[actor] = time.monotonic() + LONGEST_WAIT, request
                answer(actor)

    def _sample(self, request: Request) -> bytes:
        asked = SampleRequest.decode(request.payload)
        if len(asked.ids):
            self._buffer.update_priorities(asked.ids, asked.priorities)
        if asked.drawn is None:
            return NO_BATCH
        batch = self._buffer.sample_shared(asked.drawn, min(asked.timeout, LONGEST_WAIT))
        return NO_BATCH if batch is None else batch.encode()

    def _held_out(self, request: Request) -> bytes:
        asked = HeldOutRequest.decode(request.payload)
        return HeldOutStates(*self._buffer.held_out(asked.count, asked.newest)).encode()

    def _progress(self, request: Request) -> bytes:
        asked = ProgressRequest.decode(request.payload)
        if asked.durable:
            try:
                self._buffer.sync()
            except OSError as error:  # no answer would look like a replay that is away
                raise MessageError(str(error.strerror)) from None
        if asked.drain:
            self._buffer.drain()
        return self._buffer.progress(asked.since, goal=asked.goal).encode()

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
        # Not the highest version but the latest: a resumed learner may start from an older one.
        self._weights = message
        self._buffer.weights_version = version
