"""`FloodGuard`: ends the connections of clients that send a hub far more than it accepts.

What Zenoh or a server drops has already been received, decrypted and put together. That costs the
hub a millisecond of processor time per megabyte, so a client that sends as fast as it can takes
half a core. The guard shuts out a flooder that has a certificate by name for a while. Handshakes
cost time too, and Zenoh's clients reconnect at once, 70 times a second. So a new connection of a
flooder is ignored at first, and ended at the next look.
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
from common.transport.leaky_bucket import ACTOR_QUOTA

CUT_OFF = 60.0
"""Seconds for which a flooder's new connections are ignored."""
_LOOK = 1.0
_AHEAD = 2.0
"""Amount that may come at once, in seconds at the maximum rate."""
_OVER_QUOTA = 128 * 1024
"""Bytes as which a request counts that was over its sender's quota: receiving as many costs the hub
about as much time. An actor at work has fewer than 300 of them per second, a third of what it may,
because its requests wait longer each time (`common.transport.requests.Window`)."""
_TOLERANCE = 1.5
"""Factor above the quota, because an actor over its quota sends refused chunks again."""
_log = logging.getLogger(__name__)
_log.addFilter(Seldom())


def tolerated(quota: float) -> float:
    """Returns the bytes per second that an actor with a quota of ``quota`` steps per second may
    send. A quota below the usual one counts as the usual one, because it limits what is stored."""
    return _TOLERANCE * max(quota, ACTOR_QUOTA) * FRAME_BYTES


@dataclass
class FloodGuard:
    """Watches the connections to a hub's ``port`` that are reported to it, until it is closed."""

    port: int
    trusted: Set[str]
    """Names in certificates that may send as much as they like, such as the learner's."""
    most: float
    """Maximum bytes per second from any other name."""
    now: Now = time.monotonic

    def __post_init__(self) -> None:
        self._names: dict[Address, str] = {}
        """The name in the certificate of each watched connection."""
        self._received: dict[Address, int] = {}
        self._ahead: Counter[str] = Counter()
        """Bytes by which each name is ahead of the maximum rate."""
        self._over_quota: Counter[str] = Counter()
        """Requests of each name that were over its quota, since the last look."""
        self._lately: set[str] = set()
        """Names that had a connection at any time since then."""
        self._cut_until: dict[str, float] = {}
        self._ignored: set[Address] = set()
        """Connections of names that are cut off, until they are ended."""
        self._looked = self.now()
        self._lock = threading.Lock()
        self.close = repeat("flood-guard", _LOOK, lambda _: self.look())
        """Stops watching."""

    def hear(self, name: str, address: Address, present: bool) -> None:
        """Notes a connection that begins, or has ended."""
        if name in self.trusted:
            return
        with self._lock:
            if not present:
                self._names.pop(address, None)
                self._ignored.discard(address)
                return
            self._names[address] = name
            self._lately.add(name)
            if self._cut_until.get(name, 0.0) > self.now():
                self._ignored.add(address)
                ignore_connections(self.port, {address})  # until a look ends it

    def note_over_quota(self, name: str) -> None:
        """Notes that a request of ``name`` was not taken."""
        with self._lock:
            self._over_quota[name] += 1

    def look(self) -> None:
        """Cuts off names that have sent too much since the last look."""
        # Asking the kernel about 1,000 connections takes 40 ms or more.
        received = bytes_received(self.port) if self._names else {}
        with self._lock:
            now = self.now()
            taken = (now - self._looked) * self.most
            self._looked = now
            for address, name in self._names.items():
                more = received.get(address, 0) - self._received.get(address, 0)
                self._ahead[name] += max(more, 0)  # a connection that has ended gives nothing back
            # Not of names that only the key of a request has, which may be invented.
            for name in self._lately & self._over_quota.keys():
                self._ahead[name] += self._over_quota[name] * _OVER_QUOTA
            self._over_quota.clear()
            self._lately = {*self._names.values()}
            # A reading may miss a connection, as where no more files may be open. Its former count
            # is kept, or at the next look all that it ever sent would be new.
            self._received = {
                address: received.get(address, self._received.get(address, 0))
                for address in self._names
            }
            # Unary plus drops the names that are no longer ahead.
            self._ahead = +Counter({name: ahead - taken for name, ahead in self._ahead.items()})
            floods = {name for name, ahead in self._ahead.items() if ahead > self.most * _AHEAD}
            for name in floods:
                del self._ahead[name]
                self._cut_until[name] = now + CUT_OFF
            ended = {address for address, name in self._names.items() if name in floods}
            ended |= self._ignored
            self._ignored.clear()
        for name in floods:
            text = (
                "%s sends more than %.0f MB/s, or %.0f requests/s over its quota: its connections "
                "are ended for %.0f s"
            )
            _log.warning(text, name, self.most / 1e6, self.most / _OVER_QUOTA, CUT_OFF)
        if ended:
            end_connections(self.port, ended)
