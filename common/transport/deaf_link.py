"""`DeafLink`: ends a client's connection that brings no answers any more, so that it is made anew.

If bits of Zenoh's own messages change on their way, a client may know no server any more, or drop
all that comes, for as long as the connection lasts (benchmarks/LOG.md). Keep-alives go on, so
neither side ends it.
"""

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from common.process.threads import repeat
from common.schedule import Now

_LOOK = 1.0
_FIRST_PATIENCE = 20.0
_LONGEST_PATIENCE = 600.0
_log = logging.getLogger(__name__)


@dataclass
class _Silence:
    """A key whose last request was not answered."""

    until: float
    """Time at which the connection is ended."""
    patience: float
    """Seconds that this wait takes."""


class DeafLink:
    """Notes which requests of one client are answered, until it is closed.

    Args:
        renew: ends the connection, which the transport makes anew by itself; returns whether there
            was one.
    """

    def __init__(self, renew: Callable[[], bool], now: Now = time.monotonic) -> None:
        self._renew = renew
        self._now = now
        self._lock = threading.Lock()
        self._silences: dict[str, _Silence] = {}
        self.close = repeat("deaf-link", _LOOK, lambda _: self.look())
        """Stops watching."""

    def hear(self, key: str) -> None:
        """Notes that a request at ``key`` was answered, or that nobody waits for one any more."""
        with self._lock:
            self._silences.pop(key, None)

    def miss(self, key: str) -> None:
        """Notes that a request at ``key`` has ended without an answer."""
        with self._lock:
            silence = _Silence(self._now() + _FIRST_PATIENCE, _FIRST_PATIENCE)
            self._silences.setdefault(key, silence)

    def look(self) -> None:
        """Ends the connection if a key was silent for too long.

        A server that hangs or is away looks the same, so each next wait takes twice as long.
        """
        with self._lock:
            now = self._now()
            over = {key: each for key, each in self._silences.items() if now >= each.until}
            for each in over.values():
                each.patience = min(2 * each.patience, _LONGEST_PATIENCE)
                each.until = now + each.patience
        if over and self._renew():
            text = "nothing was answered at %s, so this process has ended its connection to the hub"
            _log.warning(text, ", ".join(sorted(over)))
