"""The actor's voice: its liveliness token, and its counters once a second."""

import threading
from collections.abc import Callable

import zenoh

from common.protocol.actor_stats import ActorStats, Role
from common.protocol.run_keys import RunKeys

PERIOD = 1.0


class Heartbeat:
    """Publishes ``stats()`` from a thread of its own, so that a throttled actor still speaks."""

    def __init__(
        self,
        session: zenoh.Session,
        keys: RunKeys,
        role: Role,
        name: str,
        stats: Callable[[bool], ActorStats],
    ) -> None:
        self._stats = stats
        self._publisher = session.declare_publisher(
            keys.stats(role, name), congestion_control=zenoh.CongestionControl.DROP
        )
        self._token = session.liveliness().declare_token(keys.live(role, name))
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._beat, name="heartbeat", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Say the last counters and withdraw the token."""
        self._ended.set()
        self._thread.join()
        self._publisher.put(self._stats(True).encode())
        self._token.undeclare()  # type: ignore[no-untyped-call]

    def _beat(self) -> None:
        while not self._ended.wait(PERIOD):
            self._publisher.put(self._stats(False).encode())
