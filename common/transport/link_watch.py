"""`LinkWatch`: closes a client's connection if requests stay unanswered; Zenoh then reconnects.

Corrupted bits in Zenoh's own messages can break a connection for good: the client no longer finds
the server, or discards every answer (benchmarks/LOG.md). Neither side closes such a connection,
because keep-alives still arrive.
"""

import logging
import random
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from common.process.threads import repeat
from common.schedule import Now

_LOOK = 1.0
FIRST_PATIENCE = 20.0
"""Seconds of silence, before their spread, after which a connection is first closed."""
_LONGEST_PATIENCE = 600.0
_RECENT = 10.0
"""Seconds after its last request in which a client still counts as one that asks. Most requests
wait for 5 s; those that wait for longer never end a connection by themselves."""
_log = logging.getLogger(__name__)


def _spread() -> float:
    return random.uniform(1.0, 1.5)


@dataclass
class _Silence:
    """A key whose recent requests were all left unanswered."""

    last: float
    """Time of the last request that was not answered."""
    until: float
    """Time at which the connection is ended."""
    patience: float
    """Seconds that this wait takes, without its spread."""


class LinkWatch:
    """Notes which requests of one client are answered, until it is closed.

    Args:
        renew: ends the connection, which the transport makes anew by itself; returns whether there
            was one.
        spread: draws the factor of a wait. Else all clients of a hub that was away for a moment
            would come back at once.
    """

    def __init__(
        self,
        renew: Callable[[], bool],
        now: Now = time.monotonic,
        spread: Callable[[], float] = _spread,
    ) -> None:
        self._renew = renew
        self._now = now
        self._spread = spread
        self._lock = threading.Lock()
        self._silences: dict[str, _Silence] = {}
        self.close = repeat("link-watch", _LOOK, lambda _: self.look())
        """Stops watching."""

    def answered(self, key: str) -> None:
        """Notes that a request at ``key`` was answered, or that nobody waits for one any more."""
        with self._lock:
            self._silences.pop(key, None)

    def unanswered(self, key: str) -> None:
        """Notes that a request at ``key`` was not answered, or found no server."""
        with self._lock:
            now = self._now()
            silence = self._silences.get(key)
            if silence is None or now - silence.last > _RECENT:
                until = now + FIRST_PATIENCE * self._spread()
                self._silences[key] = _Silence(now, until, FIRST_PATIENCE)
            else:
                silence.last = now

    def look(self) -> None:
        """Ends the connection if a key that is still asked was silent for too long.

        A server that hangs or is away looks the same, so each next wait takes twice as long.
        """
        with self._lock:
            now = self._now()
            silences = self._silences.items()
            self._silences = {key: each for key, each in silences if now - each.last <= _RECENT}
            over = {key: each for key, each in self._silences.items() if now >= each.until}
            for each in over.values():
                each.patience = min(2 * each.patience, _LONGEST_PATIENCE)
                each.until = now + each.patience * self._spread()
        if over and self._renew():
            text = "nothing was answered at %s: this process connects anew, as its link may be deaf"
            _log.warning(text, ", ".join(sorted(over)))
