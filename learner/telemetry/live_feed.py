"""Asks actors for live views, on behalf of all who watch; if nobody watches, it asks nothing."""

import contextlib
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

from common.errors import MessageError
from common.protocol.live_view import VIEW_SECONDS, LiveView, ViewRequest
from common.protocol.run_keys import RunKeys
from common.schedule import Now
from common.transport.interface import Transport

_FRESH = 0.15
"""Seconds for which an answer serves everybody who asks; this bounds the actor's work."""
_MAX_KEPT = 64
_AT_ONCE = 4


class Asked(NamedTuple):
    """The actor to look at, and the kind of view."""

    role: str
    name: str
    request: ViewRequest


class LiveFeed:
    """Fetches live views for any thread; equal requests share one answer."""

    def __init__(self, transport: Transport, keys: RunKeys, now: Now = time.monotonic) -> None:
        self._transport = transport
        self._keys = keys
        self._now = now
        self._lock = threading.Lock()
        self._kept: dict[Asked, tuple[float, Future[LiveView | None]]] = {}
        self._closed = False
        self._pool = ThreadPoolExecutor(_AT_ONCE, "view")

    def look(self, asked: Asked) -> LiveView | None:
        """Returns what the actor shows; None if it does not answer, for instance while it waits."""
        return self.begin(asked).result()

    def latest(self, asked: Asked) -> LiveView | None:
        """Returns the answer to the last request, and asks again, without waiting; None if there is
        no answer yet, or the request failed."""
        with self._lock:
            _, view = self._kept.get(asked, (0.0, None))
        self.begin(asked)
        if view is None or not view.done() or view.exception() is not None:
            return None
        return view.result()

    def close(self) -> None:
        """Stops asking; requests under way end within seconds."""
        with self._lock:
            self._closed = True
        self._pool.shutdown()

    def begin(self, asked: Asked) -> Future[LiveView | None]:
        """Returns, without waiting, the future of a new request, or of one that is under way or
        fresh."""
        with self._lock:
            began, view = self._kept.get(asked, (0.0, None))
            if self._closed:
                view = Future()
                view.set_result(None)
            elif view is None or (view.done() and self._now() - began > _FRESH):
                view = self._pool.submit(self._ask, asked)
                self._kept.pop(asked, None)  # so that it becomes the newest of the kept requests
                self._kept[asked] = (self._now(), view)
                for oldest in list(self._kept)[:-_MAX_KEPT]:
                    del self._kept[oldest]
            return view

    def _ask(self, asked: Asked) -> LiveView | None:
        if self._closed:
            return None
        key = self._keys.view(asked.role, asked.name)
        for answer in self._transport.gather(key, VIEW_SECONDS, asked.request.encode()):
            with contextlib.suppress(MessageError):
                return LiveView.decode(answer.payload)
        return None
