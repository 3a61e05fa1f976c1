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
from typing import Self, TypeVar

from common.errors import MessageError
from common.transport.interface import Answer, Envelope, Unanswered
from common.transport.requests import LONGEST_ANSWER, PendingRequests, answer_request

_log = logging.getLogger(__name__)
_T = TypeVar("_T", bound="_Declared")


class InProcessHub:
    """Where transports of one process meet, as processes do at a hub."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.declared: list[_Declared] = []

    def connect(self) -> "InProcessTransport":
        """Return a transport that reaches all others of this hub."""
        return InProcessTransport(self)

    def find(self, kind: type[_T], key: str) -> list[_T]:
        """Return all of ``kind`` that are declared at ``key``, in the order of declaration."""
        with self.lock:
            return [
                each
                for each in self.declared
                if isinstance(each, kind) and intersects(each.key, key)
            ]


class InProcessTransport:
    """Implements `Transport`."""

    def __init__(self, hub: InProcessHub) -> None:
        self.hub = hub
        self._requesters: list[_Requester] = []
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
        with self.hub.lock:
            own = [each for each in self.hub.declared if each.transport is self]
        for declared in own:
            declared.close()
            declared.forsake()
        for requester in self._requesters:
            requester.close()
        self._events.put(None)
        self._thread.join(LONGEST_ANSWER)

    def serve(self, key: str, answer: Answer) -> "_Service":
        """See `Transport.serve`."""
        return _Service(self, key, answer)

    def requester(self, key: str, deadline: float) -> "_Requester":
        """See `Transport.requester`."""
        self._requesters.append(_Requester(self, key, deadline))
        return self._requesters[-1]

    def gather(self, key: str, deadline: float) -> list[Envelope]:
        """See `Transport.gather`."""
        found: list[Envelope | Exception] = []
        ended = threading.Event()
        self.ask(key, b"", deadline, found.append, ended.set)
        ended.wait()
        return [each for each in found if isinstance(each, Envelope)]

    def publisher(self, key: str) -> "_Publisher":
        """See `Transport.publisher`."""
        return _Publisher(self, key)

    def subscribe(self, key: str, callback: Callable[[Envelope], None]) -> "_Subscription":
        """See `Transport.subscribe`."""
        return _Subscription(self, key, callback)

    def announce(self, key: str) -> "_Token":
        """See `Transport.announce`."""
        return _Token(self, key)

    def watch_presence(self, key: str, callback: Callable[[str, bool], None]) -> "_Watch":
        """See `Transport.watch_presence`."""
        return _Watch(self, key, callback)

    def ask(
        self,
        key: str,
        payload: bytes,
        deadline: float,
        hear: Callable[[Envelope | Exception], None],
        end: Callable[[], None],
    ) -> None:
        """Ask all servers at ``key``; ``hear`` each and ``end`` once, as soon as all are heard."""
        with self.hub.lock:
            services = self.hub.find(_Service, key)
            asked = _Asked(self, len(services), hear, end)
            self.call(partial(self._expire_at, time.monotonic() + deadline, asked.end))
            for service in services:
                service.put(_Request(service, asked, key, payload))
        if not services:
            asked.end()

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
    """Anything that others at the hub can find, until it is closed."""

    def __init__(self, transport: InProcessTransport, key: str) -> None:
        self.transport = transport
        self.key = key
        with transport.hub.lock:
            transport.hub.declared.append(self)
            self.opened()

    def close(self) -> None:
        with self.transport.hub.lock:
            if self not in self.transport.hub.declared:
                return
            self.transport.hub.declared.remove(self)
        self.closed()

    def opened(self) -> None:
        """What follows from being found."""

    def closed(self) -> None:
        """What follows from being found no longer."""

    def forsake(self) -> None:
        """What follows from the death of the process."""


class _Publisher:
    """Implements `interface.Publisher`."""

    def __init__(self, transport: InProcessTransport, key: str) -> None:
        self._hub = transport.hub
        self._key = key

    def publish(self, payload: bytes, attachment: bytes = b"") -> None:
        envelope = Envelope(bytes(payload), attachment, self._key)
        with self._hub.lock:
            for each in self._hub.find(_Subscription, self._key):
                each.transport.call(partial(each.callback, envelope))

    def close(self) -> None:
        """Nobody knows of a publisher."""


class _Subscription(_Declared):
    def __init__(
        self, transport: InProcessTransport, key: str, callback: Callable[[Envelope], None]
    ) -> None:
        self.callback = callback
        super().__init__(transport, key)


class _Watch(_Declared):
    """Hears of presence."""

    def __init__(
        self, transport: InProcessTransport, key: str, callback: Callable[[str, bool], None]
    ) -> None:
        self._callback = callback
        super().__init__(transport, key)

    def opened(self) -> None:
        for token in self.transport.hub.find(_Token, self.key):
            self.hear(token.key, True)

    def hear(self, key: str, present: bool) -> None:
        self.transport.call(partial(self._callback, key, present))


class _Token(_Declared):
    """Somebody's presence."""

    def opened(self) -> None:
        self._tell(True)

    def closed(self) -> None:
        self._tell(False)

    def _tell(self, present: bool) -> None:
        for watch in self.transport.hub.find(_Watch, self.key):
            watch.hear(self.key, present)


class _Asked:
    """The way back to who asked; it ends when all servers have ended the request, or in time."""

    def __init__(
        self,
        asker: InProcessTransport,
        servers: int,
        hear: Callable[[Envelope | Exception], None],
        end: Callable[[], None],
    ) -> None:
        self.end = end
        self._asker = asker
        self._servers = servers
        self._hear = hear
        self._lock = threading.Lock()

    def settle(self, outcome: Envelope | Exception | None) -> None:
        """One server's answer or refusal; None of one that dropped the request."""
        with self._lock:
            if outcome is not None:
                self._asker.call(partial(self._hear, outcome))
            self._servers -= 1
            if not self._servers:
                self._asker.call(self.end)


class _Request:
    """Implements `interface.Request`."""

    def __init__(self, service: "_Service", asked: _Asked, key: str, payload: bytes) -> None:
        self.key = key
        self.payload = bytes(payload)
        self._service = service
        self._asked = asked

    def reply(self, answer: bytes | Envelope) -> None:
        payload, attachment, _ = answer if isinstance(answer, Envelope) else Envelope(answer)
        own = self._service.key
        self._settle(Envelope(bytes(payload), attachment, self.key if "*" in own else own))

    def refuse(self, reason: str) -> None:
        self._settle(MessageError(reason))

    def drop(self) -> None:
        self._settle(None)

    def _settle(self, outcome: Envelope | Exception | None) -> None:
        if self._service.release(self):
            self._asked.settle(outcome)


class _Service(_Declared):
    """A queue of requests, and the thread that answers them."""

    def __init__(self, transport: InProcessTransport, key: str, answer: Answer) -> None:
        self._queue: queue.SimpleQueue[_Request | None] = queue.SimpleQueue()
        self._unended: set[_Request] = set()
        self._answer = answer
        self._open = True
        self._thread = threading.Thread(target=self._work, name=f"serve {key}", daemon=True)
        self._thread.start()
        super().__init__(transport, key)

    def put(self, request: _Request) -> None:
        """Have ``request`` answered after all before it."""
        self._unended.add(request)
        self._queue.put(request)

    def release(self, request: _Request) -> bool:
        """Note that ``request`` has ended; return whether it had not."""
        with self.transport.hub.lock:
            there = request in self._unended
            self._unended.discard(request)
            return there

    def closed(self) -> None:
        self._open = False
        self._queue.put(None)
        self._thread.join(LONGEST_ANSWER)

    def forsake(self) -> None:
        for request in list(self._unended):
            request.drop()

    def _work(self) -> None:
        while (request := self._queue.get()) is not None:
            if self._open:
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
        return bool(self._transport.hub.find(_Service, self._key))

    def request(self, payload: bytes) -> Future[Envelope]:
        settle, future = self._pending.settle, self._pending.begin()
        if not future.done():
            end = partial(settle, future, Unanswered("nobody answered"))
            self._transport.ask(self._key, payload, self._deadline, partial(settle, future), end)
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
