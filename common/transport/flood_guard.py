"""`FloodGuard`: ends the connections of who sends a hub far more than it takes of anybody.

What Zenoh or a server drops has been received, decrypted and put together before: a millisecond of
the hub's processor time for each megabyte, so that a client which sends as fast as it can takes
half of a core. One with a certificate by name is not heard for a while instead. Its handshakes cost
too, and Zenoh's clients come back at once, 70 times a second: so a new connection of it is ignored
at first, and ended at the next look.
"""

import logging
import threading
import time
from collections import Counter
from collections.abc import Set
from dataclasses import dataclass

from common.process.log_lines import Seldom
from common.process.threads import repeat
from common.protocol.step_fields import FRAME_BYTES
from common.schedule import Now
from common.transport.hub_sockets import (
    Address,
    bytes_received,
    end_connections,
    ignore_connections,
)
from common.transport.leaky_bucket import STEPS_PER_SECOND

CUT_OFF = 60.0
"""Seconds for which a flooder's connections are ignored as soon as they are made."""
_LOOK = 1.0
_AHEAD = 2.0
"""Seconds of what is taken at most that may come at once."""
_TOLERANCE = 1.5
"""Who sends more than its quota sends again what was turned away."""
_log = logging.getLogger(__name__)
_log.addFilter(Seldom())


def tolerated(quota: float) -> float:
    """Returns how many bytes per second an actor may send whose quota is ``quota`` steps per
    second; a quota below the usual one counts as the usual one, since it limits what is stored."""
    return _TOLERANCE * max(quota, STEPS_PER_SECOND) * FRAME_BYTES


@dataclass
class FloodGuard:
    """Watches the connections to a hub's ``port``, of which it is told, until it is closed."""

    port: int
    trusted: Set[str]
    """Names in certificates that may send as much as they like, such as the learner's."""
    most: float
    """Bytes per second that are received of any other name."""
    now: Now = time.monotonic

    def __post_init__(self) -> None:
        self._names: dict[Address, str] = {}
        """The name in the certificate of each connection that is watched."""
        self._received: dict[Address, int] = {}
        self._ahead: Counter[str] = Counter()
        """Bytes by which a name is ahead of what is taken of it."""
        self._cut_until: dict[str, float] = {}
        self._ignored: set[Address] = set()
        """Connections of who is cut off, until they are ended."""
        self._looked = self.now()
        self._lock = threading.Lock()
        self.close = repeat("flood-guard", _LOOK, lambda _: self.look())
        """Watches no more."""

    def hear(self, name: str, address: Address, present: bool) -> None:
        """Take note of a connection that begins, or has ended."""
        if name in self.trusted:
            return
        with self._lock:
            if not present:
                self._names.pop(address, None)
                self._ignored.discard(address)
                return
            self._names[address] = name
            if self._cut_until.get(name, 0.0) > self.now():
                self._ignored.add(address)
                ignore_connections(self.port, {address})  # before a look can end it

    def look(self) -> None:
        """Cut off who has sent too much since the last look."""
        # To ask the kernel of 1,000 connections takes 40 ms and more.
        received = bytes_received(self.port) if self._names else {}
        with self._lock:
            now = self.now()
            taken = (now - self._looked) * self.most
            self._looked = now
            for address, name in self._names.items():
                more = received.get(address, 0) - self._received.get(address, 0)
                self._ahead[name] += max(more, 0)  # one that has ended pays nothing back
            self._received = received
            # Who is ahead no more is forgotten.
            self._ahead = +Counter({name: ahead - taken for name, ahead in self._ahead.items()})
            floods = {name for name, ahead in self._ahead.items() if ahead > self.most * _AHEAD}
            for name in floods:
                del self._ahead[name]
                self._cut_until[name] = now + CUT_OFF
            ended = {address for address, name in self._names.items() if name in floods}
            ended |= self._ignored
            self._ignored.clear()
        for name in floods:
            text = "%s sends more than %.0f MB/s: its connections are ended for %.0f s"
            _log.warning(text, name, self.most / 1e6, CUT_OFF)
        if ended:
            end_connections(self.port, ended)
