"""Announces an actor's presence, and publishes its counters once a second."""

import time
from collections.abc import Callable
from dataclasses import replace

from actors.member import Member
from common.process.threads import repeat
from common.protocol.actor_stats import MAX_HEARTBEATS, ActorStats, Role

PERIOD = 1.0


class Heartbeat:
    """Publishes ``stats()`` from a thread of its own, so that a throttled actor is still heard."""

    def __init__(self, member: Member, role: Role, stats: Callable[[bool], ActorStats]) -> None:
        transport, keys = member.transport, member.keys
        self._stats = stats
        self._run_id = keys.run_id
        self._publisher = transport.publisher(keys.stats(role, member.name))
        self._presence = transport.announce(keys.live(role, member.name))
        self._end = repeat("heartbeat", PERIOD, lambda _: self._publish(leaving=False))

    def close(self) -> None:
        """Publishes the last counters and ends the presence."""
        self._end()
        time.sleep(2 / MAX_HEARTBEATS)  # a heartbeat may have been sent just now
        self._publish(leaving=True)
        self._presence.close()

    def _publish(self, *, leaving: bool) -> None:
        self._publisher.publish(replace(self._stats(leaving), run_id=self._run_id).encode())
