"""Asks actors what they show, on behalf of all who watch: nobody watches, nobody asks."""

import contextlib
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

from common.errors import MessageError
from common.protocol.live_view import LiveView, ViewRequest
from common.protocol.run_keys import RunKeys
from common.schedule import Now
from common.transport.interface import Transport

_DEADLINE = 5.0
"""Seconds; an actor plays on for a while between two looks that take long."""
_FRESH = 0.15
"""Seconds for which an answer serves all who ask: so much is the work of an actor bounded by."""
_MOST_KEPT = 64
_AT_ONCE = 4


class Asked(NamedTuple):
    """Whom to look at, and how."""

    role: str
    name: str
    request: ViewRequest


class LiveFeed:
    """Answers threads that want to see an actor; two that want the same get one answer."""

    def __init__(self, transport: Transport, keys: RunKeys, now: Now = time.monotonic) -> None:
        self._transport = transport
        self._keys = keys
        self._now = now
        self._lock = threading.Lock()
        self._kept: dict[Asked, tuple[float, Future[LiveView | None]]] = {}
        self._closed = False
        self._pool = ThreadPoolExecutor(_AT_ONCE, "view")

    def look(self, asked: Asked) -> LiveView | None:
        """Returns what the actor shows; None if it does not answer, as one that waits."""
        return self._begin(asked).result()

    def latest(self, asked: Asked) -> LiveView | None:
        """Returns what it showed when it was last asked, without waiting, and asks again; None for
        nothing yet."""
        with self._lock:
            _, view = self._kept.get(asked, (0.0, None))
        self._begin(asked)
        return view.result() if view is not None and view.done() else None

    def close(self) -> None:
        """Ask no more; what is asked ends within seconds."""
        with self._lock:
            self._closed = True
        self._pool.shutdown()

    def _begin(self, asked: Asked) -> Future[LiveView | None]:
        """Returns an answer to come, or one that is fresh."""
        with self._lock:
            began, view = self._kept.get(asked, (0.0, None))
            if self._closed:
                view = Future()
                view.set_result(None)
            elif view is None or (view.done() and self._now() - began > _FRESH):
                view = self._pool.submit(self._ask, asked)
                self._kept.pop(asked, None)  # or it would count as old as when it was first asked
                self._kept[asked] = (self._now(), view)
                for oldest in list(self._kept)[:-_MOST_KEPT]:
                    del self._kept[oldest]
            return view

    def _ask(self, asked: Asked) -> LiveView | None:
        if self._closed:
            return None
        key = self._keys.view(asked.role, asked.name)
        for answer in self._transport.gather(key, _DEADLINE, asked.request.encode()):
            with contextlib.suppress(MessageError):
                return LiveView.decode(answer.payload)
        return None
