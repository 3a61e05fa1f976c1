"""`InProcessTransport`: the verbs of `Transport` between the objects of one process.

It keeps what Zenoh promises and no more, so that what works here works there: servers answer on
threads of their own, callbacks come in order on one thread of each transport, and a request that
nobody answers ends unanswered. It has no network that could fail.
"""

import heapq
import itertools
import logging
import queue
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from functools import partial
from typing import Any, Self

from common.errors import MessageError
from common.transport.interface import (
    Answer,
    Closeable,
    Envelope,
    Publisher,
    Requester,
    Unanswered,
)
from common.transport.requests import LONGEST_ANSWER, PendingRequests, answer_request

_log = logging.getLogger(__name__)


class InProcessHub:
    """Where transports of one process meet, as processes do at a hub."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.services: list[_Service] = []
        self.listeners: list[_Listener] = []
        self.tokens: list[_Token] = []

    def connect(self) -> "InProcessTransport":
        """Return a transport that reaches all others of this hub."""
        return InProcessTransport(self)

    def tell(self, key: str, news: object, *, of_presence: bool) -> None:
        """Have all who listen at ``key`` called with it and ``news``."""
        with self.lock:
            for listener in self.listeners:
                if listener.of_presence == of_presence and intersects(listener.key, key):
                    listener.hear(key, news)


class InProcessTransport:
    """Implements `Transport`."""

    def __init__(self, hub: InProcessHub) -> None:
        self._hub = hub
        self._declared: list[Closeable] = []
        self._events: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._deadlines: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._thread = threading.Thread(target=self._work, name="in-process", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """See `Transport`."""
        for declared in self._declared:
            declared.close()
            if isinstance(declared, _Service):
                declared.drop_kept()
        self._declared.clear()
        self._events.put(None)
        self._thread.join()

    def serve(self, key: str, answer: Answer) -> Closeable:
        """See `Transport.serve`."""
        service = _Service(self._hub, key, answer)
        self._declared.append(service)
        return service

    def requester(self, key: str, deadline: float) -> Requester:
        """See `Transport.requester`."""
        requester = _Requester(self, key, deadline)
        self._declared.append(requester)
        return requester

    def gather(self, key: str, deadline: float) -> list[Envelope]:
        """See `Transport.gather`."""
        found: list[Envelope] = []
        ended = threading.Event()

        def hear(outcome: Envelope | Exception) -> None:
            if isinstance(outcome, Envelope):
                found.append(outcome)

        self.ask(key, b"", deadline, hear, ended.set)
        ended.wait()
        return found

    def publisher(self, key: str) -> Publisher:
        """See `Transport.publisher`."""
        return _Publisher(self._hub, key)

    def subscribe(self, key: str, callback: Callable[[Envelope], None]) -> Closeable:
        """See `Transport.subscribe`."""

        def hear(key: str, news: object) -> None:
            assert isinstance(news, Envelope)
            self.call(partial(callback, news))

        listener = _Listener(self._hub, key, hear, of_presence=False)
        self._declared.append(listener)
        return listener

    def announce(self, key: str) -> Closeable:
        """See `Transport.announce`."""
        token = _Token(self._hub, key)
        self._declared.append(token)
        return token

    def watch_presence(self, key: str, callback: Callable[[str, bool], None]) -> Closeable:
        """See `Transport.watch_presence`."""

        def hear(key: str, news: object) -> None:
            self.call(partial(callback, key, bool(news)))

        with self._hub.lock:
            for token in self._hub.tokens:
                if intersects(token.key, key):
                    hear(token.key, True)
            listener = _Listener(self._hub, key, hear, of_presence=True)
        self._declared.append(listener)
        return listener

    def ask(
        self,
        key: str,
        payload: bytes,
        deadline: float,
        hear: Callable[[Envelope | Exception], None],
        end: Callable[[], None],
    ) -> None:
        """Ask all servers at ``key``; ``hear`` each and ``end`` once, as soon as all are heard."""
        with self._hub.lock:
            services = [each for each in self._hub.services if intersects(each.key, key)]
            asked = _Asked(self, hear, end, len(services))
            self.call(partial(self._expire_at, time.monotonic() + deadline, asked.expire))
            for service in services:
                service.put(_Request(asked, service, key, payload))
        if not services:
            asked.expire()

    def has_server(self, key: str) -> bool:
        """Return whether anybody serves at ``key``."""
        with self._hub.lock:
            return any(intersects(service.key, key) for service in self._hub.services)

    def call(self, event: Callable[[], None]) -> None:
        """Have ``event`` called on this transport's thread, after all before it."""
        self._events.put(event)

    def _expire_at(self, moment: float, expire: Callable[[], None]) -> None:
        heapq.heappush(self._deadlines, (moment, next(self._order), expire))

    def _work(self) -> None:
        event: Callable[[], None] | None
        while True:
            try:
                left = self._deadlines[0][0] - time.monotonic() if self._deadlines else None
                event = self._events.get(timeout=None if left is None else max(left, 0.0))
            except queue.Empty:
                event = heapq.heappop(self._deadlines)[2]
            if event is None:
                break
            try:
                event()
            except Exception:
                _log.exception("a callback failed")
        for _, _, expire in self._deadlines:
            expire()


class _Declared:
    """Anything that is listed at a hub until it is closed."""

    def __init__(self, hub: InProcessHub, key: str) -> None:
        self.key = key
        self._hub = hub

    def _withdraw(self, place: list[Any]) -> bool:
        """Take this off ``place``; return whether it was there."""
        with self._hub.lock:
            there = self in place
            if there:
                place.remove(self)
            return there


class _Listener(_Declared):
    """A subscription, or a watch of presence."""

    def __init__(
        self,
        hub: InProcessHub,
        key: str,
        hear: Callable[[str, object], None],
        *,
        of_presence: bool,
    ) -> None:
        super().__init__(hub, key)
        self.hear = hear
        self.of_presence = of_presence
        with hub.lock:
            hub.listeners.append(self)

    def close(self) -> None:
        self._withdraw(self._hub.listeners)


class _Token(_Declared):
    """Somebody's presence."""

    def __init__(self, hub: InProcessHub, key: str) -> None:
        super().__init__(hub, key)
        with hub.lock:
            hub.tokens.append(self)
            hub.tell(key, True, of_presence=True)

    def close(self) -> None:
        with self._hub.lock:
            if self._withdraw(self._hub.tokens):
                self._hub.tell(self.key, False, of_presence=True)


class _Publisher(_Declared):
    """Implements `interface.Publisher`."""

    def publish(self, payload: bytes, attachment: bytes = b"") -> None:
        message = Envelope(bytes(payload), attachment, self.key)
        self._hub.tell(self.key, message, of_presence=False)

    def close(self) -> None:
        pass


class _Asked:
    """A request's way back to who asked; it ends when all servers have ended it, or in time."""

    def __init__(
        self,
        asker: InProcessTransport,
        hear: Callable[[Envelope | Exception], None],
        end: Callable[[], None],
        servers: int,
    ) -> None:
        self._asker = asker
        self._hear = hear
        self._end = end
        self._servers = servers
        self._lock = threading.Lock()

    def settle(self, outcome: Envelope | Exception | None) -> None:
        """One server's answer or refusal; None of one that dropped the request."""
        with self._lock:
            if not self._servers:
                return  # too late
            if outcome is not None:
                self._asker.call(partial(self._hear, outcome))
            self._servers -= 1
            if not self._servers:
                self._asker.call(self._end)

    def expire(self) -> None:
        """End it, whoever has not answered."""
        with self._lock:
            self._servers = 0
        self._end()


class _Request:
    """Implements `interface.Request`."""

    def __init__(self, asked: _Asked, service: "_Service", key: str, payload: bytes) -> None:
        self.key = key
        self.payload = bytes(payload)
        self._asked = asked
        self._service = service
        self._reply_key = key if "*" in service.key else service.key

    def reply(self, answer: bytes | Envelope) -> None:
        payload, attachment, _ = answer if isinstance(answer, Envelope) else Envelope(answer)
        self._settle(Envelope(bytes(payload), attachment, self._reply_key))

    def refuse(self, reason: str) -> None:
        self._settle(MessageError(reason))

    def drop(self) -> None:
        self._settle(None)

    def _settle(self, outcome: Envelope | Exception | None) -> None:
        if self._service.forget(self):
            self._asked.settle(outcome)


class _Service(_Declared):
    """A queue of requests, and the thread that answers them."""

    def __init__(self, hub: InProcessHub, key: str, answer: Answer) -> None:
        super().__init__(hub, key)
        self._requests: queue.SimpleQueue[_Request | None] = queue.SimpleQueue()
        self._unended: set[_Request] = set()
        self._answer = answer
        self._thread = threading.Thread(target=self._work, name=f"serve {key}", daemon=True)
        self._thread.start()
        with hub.lock:
            hub.services.append(self)

    def put(self, request: _Request) -> None:
        with self._hub.lock:
            self._unended.add(request)
        self._requests.put(request)

    def forget(self, request: _Request) -> bool:
        """Note that ``request`` has ended; return whether it had not."""
        with self._hub.lock:
            there = request in self._unended
            self._unended.discard(request)
            return there

    def drop_kept(self) -> None:
        """Drop what nobody has ended, as the death of a process does."""
        with self._hub.lock:
            kept = list(self._unended)
        for request in kept:
            request.drop()

    def close(self) -> None:
        if self._withdraw(self._hub.services):
            self._requests.put(None)
        self._thread.join(LONGEST_ANSWER)

    def _work(self) -> None:
        while (request := self._requests.get()) is not None:
            if self in self._hub.services:
                answer_request(request, self._answer)
            else:
                request.drop()


class _Requester:
    """Implements `interface.Requester`."""

    def __init__(self, transport: InProcessTransport, key: str, deadline: float) -> None:
        self._transport = transport
        self._key = key
        self._deadline = deadline
        self._pending = PendingRequests()

    @property
    def has_server(self) -> bool:
        return self._transport.has_server(self._key)

    def request(self, payload: bytes) -> Future[Envelope]:
        pending, future = self._pending, self._pending.begin()
        if not future.done():
            self._transport.ask(
                self._key,
                payload,
                self._deadline,
                partial(pending.settle, future),
                lambda: pending.settle(future, Unanswered("nobody answered")),
            )
        return future

    def close(self) -> None:
        self._pending.close()


def intersects(one: str, other: str) -> bool:
    """Return whether some key is meant by both, where ``*`` and ``**`` stand for others."""
    return _intersects(one.split("/"), other.split("/"))


def _intersects(one: Sequence[str], other: Sequence[str]) -> bool:
    if not one or not other:
        return all(part == "**" for part in (*one, *other))
    if one[0] == "**":
        return _intersects(one[1:], other) or _intersects(one, other[1:])
    if other[0] == "**":
        return _intersects(other, one)
    return (one[0] == other[0] or "*" in (one[0], other[0])) and _intersects(one[1:], other[1:])
