"""Receives the learner's weights: each broadcast, or, for a late joiner, the latest weights."""

import contextlib
import math
import time
from collections import deque

from common.errors import MessageError
from common.protocol.run_keys import RunKeys
from common.protocol.wire import MAX_MESSAGE_BYTES, decode_version
from common.transport.interface import Envelope, Transport, Unanswered

_FETCH_TIMEOUT = 5.0
_FETCH_PERIOD = 0.5
"""Minimum seconds between two requests: a hub answers 5 a second per connection, and drops others.
"""


class WeightsClient:
    """Keeps only the latest weights that nobody has taken yet.

    The latest may not have the largest version: a killed learner comes back with an older one.
    """

    def __init__(self, transport: Transport, keys: RunKeys) -> None:
        self._run_id = keys.run_id
        # The transport's thread appends broadcasts, the actor's thread what it fetched; only that
        # takes out.
        self._latest: deque[tuple[int, bytes, bytes]] = deque(maxlen=1)
        self._broadcasts = 0
        """Number of weights that came without being asked for."""
        self._asked = -math.inf
        self._requester = transport.requester(keys.latest_weights, _FETCH_TIMEOUT)
        self._subscription = transport.subscribe(keys.weights, self._hear)

    def take(self) -> tuple[int, bytes, bytes] | None:
        """Returns version, safetensors bytes and signature, all unchecked; None if taken before."""
        return self._latest.pop() if self._latest else None

    def fetch(self) -> None:
        """Requests the latest weights, since broadcasts may be dropped, but not too often."""
        if time.monotonic() - self._asked < _FETCH_PERIOD:
            return
        self._asked = time.monotonic()
        heard = self._broadcasts
        with contextlib.suppress(Unanswered, MessageError):  # there may be none yet
            answer = self._requester.request(b"").result()
            if heard == self._broadcasts:  # else one that came meanwhile is newer
                self._receive(answer)

    def _hear(self, message: Envelope) -> None:
        self._broadcasts += self._receive(message)

    def _receive(self, message: Envelope) -> bool:
        """Keeps the weights in ``message``; returns whether it has any of this run."""
        if len(message.payload) > MAX_MESSAGE_BYTES:
            return False
        try:
            version, signature = decode_version(message.attachment, self._run_id)
        except MessageError:
            return False
        self._latest.append((version, message.payload, signature))
        return True
