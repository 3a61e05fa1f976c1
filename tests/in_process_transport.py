"""The verbs of `Transport` between the objects of one process, for tests in milliseconds.

It keeps what the interface promises and no more: servers answer on threads of their own, callbacks
come in order on one thread of each transport, and a request that nobody answers ends unanswered.
"""

import asyncio
import contextlib
import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, Self, TypeVar

import zenoh

from common.errors import MessageError
from common.process.threads import guarded
from common.transport.interface import Answer, Closeable, Envelope, Unanswered
from common.transport.requests import PendingRequests, answer_request

Kind = Literal["service", "subscription", "token", "watch", "shut out"]
_T = TypeVar("_T", bound=Closeable)


class InProcessHub:
    """Where transports of one process meet, as processes do at a hub."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.declared: list[_Declared] = []

    def connect(self) -> "InProcessTransport":
        """Returns a transport that reaches all others of this hub."""
        return InProcessTransport(self)

    def find(self, kind: Kind, key: str) -> "list[_Declared]":
        """Returns all of ``kind`` that are declared at ``key``, in the order of declaration."""
        wanted = zenoh.KeyExpr(key)
        with self.lock:
            return [
                each
                for each in self.declared
                if each.kind == kind and wanted.intersects(zenoh.KeyExpr(each.key))
            ]


@dataclass(eq=False)
class _Declared:
    """Anything that others at the hub can find, until it is closed."""

    hub: InProcessHub
    kind: Kind
    key: str
    tell: Callable[..., Any]
    """Called with what comes to it, under the hub's lock."""
    end: Callable[[], object] = lambda: None
    """Called once, under the same lock."""
    wait: Callable[[], object] = lambda: None
    """Waits for what is still being done."""

    def close(self) -> None:
        with self.hub.lock:
            if self in self.hub.declared:
                self.hub.declared.remove(self)
                self.end()
        self.wait()


class InProcessTransport:
    """Implements `Transport`."""

    def __init__(self, hub: InProcessHub) -> None:
        self.hub = hub
        self.over_quota: Counter[str] = Counter()
        self._own: list[Closeable] = []
        self._served = PendingRequests()
        """Requests to this transport's services; those without an answer end with the transport."""
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """See `Transport`."""
        for each in (*self._own, self._served):
            each.close()
        if not self._loop.is_closed():
            self.call(self._loop.stop)
            self._thread.join()
            self._loop.close()

    def call(self, work: Callable[..., object], *arguments: object) -> None:
        """Have ``work`` called on this transport's thread, after all before it."""
        with contextlib.suppress(RuntimeError):  # it is closed, and nobody waits for it any more
            self._loop.call_soon_threadsafe(work, *arguments)

    def call_after(self, seconds: float, work: Callable[..., object], *arguments: object) -> None:
        """The same, when so many seconds have passed."""
        self.call(partial(self._loop.call_later, seconds, work, *arguments))

    def serve(self, key: str, answer: Answer) -> Closeable:
        """See `Transport.serve`."""
        thread = ThreadPoolExecutor(1, f"serve {key}")

        def tell(asked_at: str, payload: bytes) -> Future[Envelope]:
            future = self._served.begin()
            settle = partial(self._served.settle, future)
            request = _Request(asked_at, payload, asked_at if "*" in key else key, settle)
            work = thread.submit(answer_request, request, answer)
            work.add_done_callback(lambda work: request.drop() if work.cancelled() else None)
            return future

        drop_waiting = partial(thread.shutdown, wait=False, cancel_futures=True)
        return self._declare("service", key, tell, drop_waiting, thread.shutdown)

    def requester(self, key: str, deadline: float) -> "_Requester":
        """See `Transport.requester`."""
        return self._keep(_Requester(self, key, deadline))

    def gather(self, key: str, deadline: float, payload: bytes = b"") -> list[Envelope]:
        """See `Transport.gather`."""
        ended, _ = wait(self.ask(key, payload), deadline)
        return [each.result() for each in ended if each.exception() is None]

    def publisher(self, key: str) -> "_Publisher":
        """See `Transport.publisher`."""
        return _Publisher(self.hub, key)

    def subscribe(self, key: str, callback: Callable[[Envelope], None]) -> Closeable:
        """See `Transport.subscribe`."""
        return self._declare("subscription", key, partial(self.call, guarded(key, callback)))

    def announce(self, key: str) -> Closeable:
        """See `Transport.announce`."""

        def tell(present: bool) -> None:
            for watch in self.hub.find("watch", key):
                watch.tell(key, present)

        with self.hub.lock:
            tell(True)
            return self._declare("token", key, tell, partial(tell, False))

    def watch_presence(self, key: str, callback: Callable[[str, bool], None]) -> Closeable:
        """See `Transport.watch_presence`."""
        with self.hub.lock:
            for token in self.hub.find("token", key):
                self.call(guarded(key, callback), token.key, True)
            return self._declare("watch", key, partial(self.call, guarded(key, callback)))

    def note_over_quota(self, name: str) -> None:
        """See `Transport.note_over_quota`; here ``over_quota`` counts."""
        self.over_quota[name] += 1

    def watch_shut_out(self, callback: Callable[[str, str], None]) -> Closeable:
        """See `Transport.watch_shut_out`."""
        return self._declare("shut out", "", callback)

    def ask(self, key: str, payload: bytes) -> list[Future[Envelope]]:
        """Returns the answers to come of all servers at ``key``."""
        with self.hub.lock:
            return [service.tell(key, payload) for service in self.hub.find("service", key)]

    def _declare(self, kind: Kind, key: str, *calls: Callable[..., Any]) -> Closeable:
        declared = _Declared(self.hub, kind, key, *calls)
        with self.hub.lock:
            self.hub.declared.append(declared)
        return self._keep(declared)

    def _keep(self, own: _T) -> _T:
        self._own.append(own)
        return own


@dataclass
class _Request:
    """Implements `interface.Request`."""

    key: str
    payload: bytes
    reply_key: str
    settle: Callable[[Envelope | Exception], None]

    @property
    def size(self) -> int:
        return len(self.payload)

    def reply(self, answer: bytes | Envelope) -> None:
        payload, attachment, _ = answer if isinstance(answer, Envelope) else Envelope(answer)
        self.settle(Envelope(bytes(payload), attachment, self.reply_key))

    def refuse(self, reason: str) -> None:
        self.settle(MessageError(reason))

    def drop(self) -> None:
        self.settle(Unanswered("the request was dropped"))


class _Requester:
    """Implements `interface.Requester`."""

    def __init__(self, transport: InProcessTransport, key: str, deadline: float) -> None:
        self._transport = transport
        self._key = key
        self._deadline = deadline
        self._pending = PendingRequests()

    @property
    def has_server(self) -> bool:
        return bool(self._transport.hub.find("service", self._key))

    def request(self, payload: bytes) -> Future[Envelope]:
        future = self._pending.begin()
        if future.done():
            return future
        settle = partial(self._pending.settle, future)
        asked = self._transport.ask(self._key, bytes(payload))

        def end(heard: Future[Envelope]) -> None:
            outcome = heard.exception() or heard.result()
            if not isinstance(outcome, Unanswered) or all(each.done() for each in asked):
                self._transport.call(settle, outcome)

        for each in asked:
            each.add_done_callback(end)
        unanswered = Unanswered("nobody answered")
        self._transport.call_after(self._deadline if asked else 0.0, settle, unanswered)
        return future

    def close(self) -> None:
        self._pending.close()


@dataclass
class _Publisher:
    """Implements `interface.Publisher`."""

    hub: InProcessHub
    key: str

    def publish(self, payload: bytes, attachment: bytes = b"") -> None:
        envelope = Envelope(bytes(payload), attachment, self.key)
        with self.hub.lock:
            for each in self.hub.find("subscription", self.key):
                each.tell(envelope)

    def close(self) -> None:
        """Nobody knows of a publisher."""
