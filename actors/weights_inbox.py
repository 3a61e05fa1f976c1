"""Receives the learner's weights: each broadcast, or the newest there is for a late joiner."""

import threading

import zenoh
from zenoh.handlers import Callback

from common.bus import RunKeys
from common.wire import MAX_MESSAGE_BYTES

_FETCH_TIMEOUT = 5.0


class WeightsInbox:
    """Keeps only the newest weights that nobody has taken yet."""

    def __init__(self, session: zenoh.Session, keys: RunKeys) -> None:
        self._session = session
        self._keys = keys
        self._lock = threading.Lock()
        self._newest: tuple[int, bytes] | None = None
        self._subscriber = session.declare_subscriber(
            keys.weights, Callback(self._receive, indirect=False)
        )

    def take(self) -> tuple[int, bytes] | None:
        """Version and safetensors bytes, once each."""
        if self._newest is None:
            return None
        with self._lock:
            found, self._newest = self._newest, None
        return found

    def fetch(self) -> None:
        """Ask for the newest weights; broadcasts may be dropped on their way."""
        for reply in self._session.get(self._keys.latest_weights, timeout=_FETCH_TIMEOUT):
            if reply.ok is not None:
                self._receive(reply.ok)

    def _receive(self, sample: zenoh.Sample) -> None:
        if sample.attachment is None or len(sample.payload) > MAX_MESSAGE_BYTES:
            return
        try:
            version = int(sample.attachment.to_bytes())
        except ValueError:
            return
        payload = sample.payload.to_bytes()
        with self._lock:
            if self._newest is None or version > self._newest[0]:
                self._newest = (version, payload)
