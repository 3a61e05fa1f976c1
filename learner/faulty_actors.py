"""Finds single actors whose robot does not see or touch, among others that do.

The health checks judge means over all actors, in which one blind robot of many does not show, and
its steps would be learned from for ever.
"""

from collections import deque

from common.metrics import Value
from common.protocol.run_keys import DEMONSTRATIONS
from replay.chunk_statistics import ChunkStatistics

LEAST_SHARE = 0.5
"""An actor is faulty if a smaller share of its newest steps saw, followed or touched: so a fault
must have lasted for most of them, and is soon forgotten when it is over."""
_NEWEST, _LEAST = 16, 8
"""Number of an actor's newest chunks that are judged, and the least number."""
_SILENCE = 32
"""An actor is forgotten after so many chunks of each actor without one of its own: it has left, or
sends nothing that could harm."""
_NAMED = 3
"""Maximum number of faulty actors that are named."""


class FaultyActors:
    """Keeps the newest chunks of each actor."""

    def __init__(self, *, keys_can_follow: bool) -> None:
        """Takes whether healthy hands press the commanded keys within their agent step."""
        self._keys_can_follow = keys_can_follow
        self._newest: dict[str, deque[ChunkStatistics]] = {}

    def add(self, chunk: ChunkStatistics) -> None:
        if chunk.actor == DEMONSTRATIONS:
            return
        newest = self._newest.pop(chunk.actor, deque(maxlen=_NEWEST))
        newest.append(chunk)
        self._newest[chunk.actor] = newest  # the last one to be forgotten
        oldest = chunk.index - _SILENCE * len(self._newest)
        while (silent := next(iter(self._newest.values()))[-1]).index < oldest:
            del self._newest[silent.actor]

    def values(self) -> dict[str, Value]:
        names = [name for name, newest in self._newest.items() if self._is_faulty(newest)]
        told = ", ".join(sorted(names)[:_NAMED])
        more = len(names) - _NAMED
        return {
            "play/faulty_actors": len(names),
            "play/faulty_actor_names": f"{told} and {more} more" if more > 0 else told,
        }

    def _is_faulty(self, newest: deque[ChunkStatistics]) -> bool:
        if len(newest) < _LEAST:
            return False
        healthy = [sum(each.valid for each in newest), sum(each.follows for each in newest)]
        if self._keys_can_follow:
            healthy.append(sum(each.matched for each in newest))
        return min(healthy) < LEAST_SHARE * sum(each.steps for each in newest)
