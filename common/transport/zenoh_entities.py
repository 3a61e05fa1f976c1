"""Entities that `ZenohTransport` declares at a Zenoh session: publishers, requesters and services.

Outgoing messages are sealed with a checksum, and damaged incoming messages are skipped.
"""

import logging
import threading
from collections.abc import Callable
from concurrent.futures import Future
from functools import cached_property
from typing import Any, TypeVar

import zenoh
from zenoh.handlers import Callback, RingChannel

from common.errors import MessageError
from common.process.log_lines import Seldom
from common.process.threads import guarded
from common.transport.checksum import DamagedMessage, seal, unseal
from common.transport.interface import Answer, Envelope, Unanswered
from common.transport.link_watch import LinkWatch
from common.transport.requests import LONGEST_ANSWER, PendingRequests, answer_request

_log = logging.getLogger(__name__)
_log.addFilter(Seldom())
_REFUSAL = "refusal"
"""Takes the place of the key in the checksum of a refusal, which has no key."""
_SEAL = seal(_REFUSAL, b"")
_QUEUE = 4_096
"""Maximum number of requests that wait at a key, such as the windows of 1,024 actors. If there are
more, the oldest end unanswered: a full queue must not block Zenoh's own receiving threads."""

_Heard = TypeVar("_Heard", zenoh.Sample, zenoh.Reply, zenoh.LinkEvent)


def callback_of(name: str, call: Callable[[_Heard], None], *end: Callable[[], None]) -> Any:
    """Returns a handler that Zenoh's own thread calls; if it fails, the process ends."""
    return Callback(guarded(name, call), *(guarded(name, each) for each in end), indirect=False)


def envelope_of(sample: zenoh.Sample) -> Envelope | None:
    """Returns the content of a publication or answer; None if it is damaged."""
    key, payload = str(sample.key_expr), sample.payload.to_bytes()
    try:
        return Envelope(payload, unseal(key, payload, _bytes(sample.attachment)), key)
    except DamagedMessage as error:
        _log.warning("what came at %s is passed over: %s", key, error)
        return None


def _bytes(content: zenoh.ZBytes | None) -> bytes:
    return b"" if content is None else content.to_bytes()


class Declared:
    """An entity of a session that can be undeclared."""

    def __init__(self, entity: Any) -> None:
        self._entity = entity
        self._closed = False

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._entity.undeclare()


class ZenohPublisher(Declared):
    """Implements `interface.Publisher`."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        super().__init__(
            session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP)
        )
        self._key = key

    def publish(self, payload: bytes, attachment: bytes = b"") -> None:
        self._entity.put(payload, attachment=seal(self._key, payload, attachment))


class _Request:
    """Implements `interface.Request`."""

    def __init__(self, query: zenoh.Query, served: str) -> None:
        self._query = query
        self.key = str(query.key_expr)
        # The server's own key, because the client's may stand for the keys of several servers.
        self._reply_key = self.key if "*" in served else served
        self.size = 0 if query.payload is None else len(query.payload)

    @cached_property
    def payload(self) -> bytes:
        payload = _bytes(self._query.payload)
        unseal(self.key, payload, _bytes(self._query.attachment))
        return payload

    def reply(self, answer: bytes | Envelope) -> None:
        payload, attachment, _ = answer if isinstance(answer, Envelope) else Envelope(answer)
        with self._query as query:
            query.reply(
                self._reply_key, payload, attachment=seal(self._reply_key, payload, attachment)
            )

    def refuse(self, reason: str) -> None:
        with self._query as query:
            text = reason.encode()
            query.reply_err(seal(_REFUSAL, text) + text)

    def drop(self) -> None:
        self._query.drop()  # type: ignore[no-untyped-call]


class Service(Declared):
    """A queryable, and the thread that answers for it."""

    def __init__(self, session: zenoh.Session, key: str, answer: Answer) -> None:
        queryable = session.declare_queryable(key, RingChannel(_QUEUE))
        super().__init__(queryable)

        def work() -> None:
            for query in queryable:
                request = _Request(query, key)
                if self._closed:
                    request.drop()
                else:
                    answer_request(request, answer)
                del query, request  # a kept request must end when its keeper releases it

        self._thread = threading.Thread(target=work, name=f"serve {key}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stops answering, and waits for the thread.

        A thread that still waits for Zenoh when the interpreter ends would crash the process with
        "FATAL: exception not rethrown".
        """
        super().close()
        self._thread.join(LONGEST_ANSWER)


class ZenohRequester:
    """Implements `interface.Requester`.

    Its querier lasts as long as the session, because it cannot be undeclared while another thread
    uses it.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        deadline: float,
        watch: LinkWatch | None = None,
    ) -> None:
        """``watch`` is told which requests are answered."""
        self._watch = watch
        self._querier: Any = session.declare_querier(
            key,
            timeout=deadline,
            consolidation=zenoh.ConsolidationMode.NONE,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        self._pending = PendingRequests()
        self._key, self._name = key, f"ask {key}"

    @property
    def has_server(self) -> bool:
        # The status object itself is always true.
        found = bool(self._querier.matching_status.matching)
        # Whoever finds none sends nothing, so that no request would end unanswered.
        if not found and self._watch is not None:
            self._watch.unanswered(self._key)
        return found

    def request(self, payload: bytes) -> Future[Envelope]:
        pending, future = self._pending, self._pending.begin()
        if future.done():
            return future

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                if (envelope := envelope_of(reply.ok)) is not None:
                    pending.settle(future, envelope)
            elif reply.err is not None:
                sealed = reply.err.payload.to_bytes()
                checksum, text = sealed[: len(_SEAL)], sealed[len(_SEAL) :]
                # Without a checksum it is damaged, or Zenoh's own report that nobody answered.
                if checksum == seal(_REFUSAL, text):
                    pending.settle(future, MessageError(text.decode(errors="replace")))

        def on_end() -> None:
            if (watch := self._watch) is not None:
                (watch.answered if future.done() else watch.unanswered)(self._key)
            pending.settle(future, Unanswered("nobody answered"))

        sealed = seal(self._key, payload)
        handler = callback_of(self._name, on_reply, on_end)
        self._querier.get(handler, payload=payload, attachment=sealed)
        return future

    def close(self) -> None:
        self._pending.close()
        if self._watch is not None:
            self._watch.answered(self._key)
