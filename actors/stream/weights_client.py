"""Receives the learner's weights: each broadcast, or the latest there is for a late joiner."""

import threading

import zenoh
from zenoh.handlers import Callback

from common.protocol.run_keys import RunKeys
from common.protocol.wire import MAX_MESSAGE_BYTES

_FETCH_TIMEOUT = 5.0


class WeightsClient:
    """Keeps only the latest weights that nobody has taken yet.

    Not those of the largest version: a learner that was killed comes back with an older one.
    """

    def __init__(self, session: zenoh.Session, keys: RunKeys) -> None:
        self._session = session
        self._keys = keys
        self._lock = threading.Lock()
        self._latest: tuple[int, bytes] | None = None
        self._subscriber = session.declare_subscriber(
            keys.weights, Callback(self._receive, indirect=False)
        )

    def take(self) -> tuple[int, bytes] | None:
        """Version and safetensors bytes, once each."""
        if self._latest is None:
            return None
        with self._lock:
            found, self._latest = self._latest, None
        return found

    def fetch(self) -> None:
        """Ask for the latest weights; broadcasts may be dropped on their way."""
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
            self._latest = (version, payload)
