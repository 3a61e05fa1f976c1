"""`ReplayServer`: a run's `ReplayBuffer` for the processes that reach it over Zenoh.

Each kind of question has a queue and a thread of its own, so a draw that waits for actors holds
up no insert. The queues hold far more than the actors' windows together, because a full one
would block Zenoh's own receiving threads. What nobody should have sent is answered with a
sentence, counted, and forgotten.
"""

import logging
import queue
import threading
import time
from collections.abc import Callable
from typing import Any

import zenoh
from zenoh.handlers import FifoChannel

from common.errors import MessageError
from common.protocol.announcement import encode_announcement
from common.protocol.chunk import Chunk
from common.protocol.run_keys import RunKeys
from common.protocol.wire import MAX_MESSAGE_BYTES
from common.run.config import RunConfig
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
_QUEUE = 4_096
_LONGEST_VERSION = 20

_log = logging.getLogger(__name__)

Answer = Callable[[zenoh.Query], None]


class ReplayServer:
    """Answers for ``memory`` until it is closed; a context manager."""

    def __init__(
        self, session: zenoh.Session, memory: ReplayBuffer, config: RunConfig, run: str
    ) -> None:
        self._closed = False
        self._memory = memory
        self._config = config
        self._keys = keys = RunKeys(run)
        self._weights: tuple[int, bytes] | None = None
        self._polls: queue.SimpleQueue[zenoh.Query | None] = queue.SimpleQueue()
        self._threads: list[threading.Thread] = []
        self._start("replay-polls", self._answer_polls)
        self._subscriber = session.declare_subscriber(keys.weights, FifoChannel(_QUEUE))
        self._start("replay-weights", self._keep_weights)
        answers: dict[str, Answer] = {
            keys.config: self._config_asked,
            keys.latest_weights: self._weights_asked,
            keys.sample: self._sample,
            keys.priorities: self._priorities,
            keys.held_out: self._held_out,
            keys.progress: self._progress,
            keys.insert("*"): self._insert,
        }
        self._queryables = [
            self._serve(session.declare_queryable(key, FifoChannel(_QUEUE)), answer)
            for key, answer in answers.items()
        ]

    def __enter__(self) -> "ReplayServer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop answering; the memory stays open."""
        if self._closed:
            return
        self._closed = True
        for queryable in self._queryables:
            queryable.undeclare()  # type: ignore[no-untyped-call]
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]
        self._polls.put(None)
        for thread in self._threads:
            thread.join(2 * LONGEST_WAIT)

    def _start(self, name: str, target: Callable[..., None], *args: Any) -> None:
        thread = threading.Thread(target=target, args=args, name=name, daemon=True)
        thread.start()
        self._threads.append(thread)

    def _serve(self, queryable: zenoh.Queryable[Any], answer: Answer) -> zenoh.Queryable[Any]:
        def loop() -> None:
            for query in queryable:
                if answer == self._insert and not _payload(query):
                    self._polls.put(query)
                    continue
                with query:
                    try:
                        answer(query)
                    except MessageError as error:
                        query.reply_err(str(error))
                    except Exception:
                        # No answer, for the message is not at fault: its sender should keep it.
                        _log.exception("a query at %s found no answer", query.key_expr)

        self._start(f"replay-{queryable.key_expr}", loop)
        return queryable

    def _insert(self, query: zenoh.Query) -> None:
        actor = str(query.key_expr).rsplit("/", 1)[-1]
        try:
            chunk = Chunk.decode(_payload(query))
            if (chunk.run, chunk.actor) != (self._keys.run, actor):
                raise MessageError(
                    f"a chunk of {chunk.run}/{chunk.actor} at the key of {self._keys.run}/{actor}"
                )
        except MessageError:
            self._memory.refuse()
            raise
        ack = self._memory.insert(chunk)
        query.reply(query.key_expr, ack.encode())

    def _answer_polls(self) -> None:
        """Throttled actors wait here, each at most `LONGEST_WAIT`, while inserts go on."""
        waiting: list[tuple[float, zenoh.Query]] = []
        while True:
            try:
                query = self._polls.get(block=not waiting)
            except queue.Empty:
                # A poll that comes meanwhile is due later than those that wait already.
                ack = self._memory.await_release(max(waiting[0][0] - time.monotonic(), 0.0))
                now, answer = time.monotonic(), ack.encode()
                going_on = ack.finished or not ack.throttle
                while waiting and (going_on or waiting[0][0] <= now):
                    with waiting.pop(0)[1] as due:
                        due.reply(due.key_expr, answer)
                continue
            if query is None:
                return
            waiting.append((time.monotonic() + LONGEST_WAIT, query))

    def _sample(self, query: zenoh.Query) -> None:
        asked = SampleRequest.decode(_payload(query))
        batch = self._memory.sample_shared(asked.drawn, min(asked.timeout, LONGEST_WAIT))
        query.reply(self._keys.sample, NO_BATCH if batch is None else batch.encode())

    def _priorities(self, query: zenoh.Query) -> None:
        advice = Priorities.decode(_payload(query))
        self._memory.update_priorities(advice.ids, advice.priorities)
        query.reply(self._keys.priorities, b"")

    def _held_out(self, query: zenoh.Query) -> None:
        held = self._memory.held_out(HeldOutRequest.decode(_payload(query)).count)
        query.reply(self._keys.held_out, HeldOutStates(*held).encode())

    def _progress(self, query: zenoh.Query) -> None:
        asked = ProgressRequest.decode(_payload(query))
        progress = self._memory.progress(asked.since, finished=asked.finished)
        query.reply(self._keys.progress, progress.encode())

    def _config_asked(self, query: zenoh.Query) -> None:
        # At the run's own key: those who look for any run ask at 'ale-robot/*/config'.
        answer = encode_announcement(self._keys.run, self._config)
        query.reply(self._keys.config, answer)

    def _weights_asked(self, query: zenoh.Query) -> None:
        if self._weights is None:
            raise MessageError("there are no weights yet")
        version, payload = self._weights
        query.reply(self._keys.latest_weights, payload, attachment=str(version))

    def _keep_weights(self) -> None:
        for sample in self._subscriber:
            text = sample.attachment.to_bytes() if sample.attachment is not None else b""
            size = len(sample.payload)
            if not text.isdigit() or len(text) > _LONGEST_VERSION or size > MAX_MESSAGE_BYTES:
                _log.warning("weights of %d bytes, version %r, were passed over", size, text)
                continue
            # Not the largest but the latest: a resumed learner may start from an older version.
            self._weights = int(text), sample.payload.to_bytes()
            self._memory.weights_version = int(text)


def _payload(query: zenoh.Query) -> bytes:
    return query.payload.to_bytes() if query.payload is not None else b""
