"""Finds single environments whose robot does not see or touch, among others that do.

The other health checks judge means over all of them, in which one blind robot of many does not
show, and its steps would be learned from for ever. This one names its actor, and ends no run.
"""

from collections import deque

from common.metrics import Value
from common.protocol.run_keys import DEMONSTRATIONS
from replay.chunk_statistics import ChunkStatistics

LEAST_SHARE = 0.5
"""An environment is faulty if a smaller share of its newest steps saw, followed or touched: so a
fault must have lasted for most of them, and is soon forgotten when it is over."""
_NEWEST, _LEAST = 16, 8
"""Number of an environment's newest chunks that are judged, and the least number."""
_SILENCE = 32
"""An environment is forgotten after so many chunks of each without one of its own: it has left, or
sends nothing that could harm."""
_MOST = 16_384
"""Maximum number of environments that are known, however many streams an actor names."""
_NAMED = 3
"""Maximum number of actors that are named."""


class FaultyEnvironments:
    """Keeps the newest chunks of each environment."""

    def __init__(self, *, keys_can_follow: bool) -> None:
        """Takes whether healthy hands press the commanded keys within their agent step."""
        self._keys_can_follow = keys_can_follow
        self._newest: dict[tuple[str, int], deque[ChunkStatistics]] = {}
        """By actor and stream; the one heard last is at the end."""
        self._faulty: set[tuple[str, int]] = set()

    def add(self, chunk: ChunkStatistics) -> None:
        if chunk.actor == DEMONSTRATIONS:
            return
        source = chunk.actor, chunk.stream
        newest = self._newest.pop(source, deque(maxlen=_NEWEST))
        newest.append(chunk)
        self._newest[source] = newest
        if self._is_faulty(newest):
            self._faulty.add(source)
        else:
            self._faulty.discard(source)
        oldest = chunk.index - _SILENCE * len(self._newest)
        while True:
            silent, (*_, last) = next(iter(self._newest.items()))
            if len(self._newest) <= _MOST and last.index >= oldest:
                break
            del self._newest[silent]
            self._faulty.discard(silent)

    def values(self) -> dict[str, Value]:
        actors = sorted({actor for actor, _ in self._faulty})
        told, more = ", ".join(actors[:_NAMED]), len(actors) - _NAMED
        return {
            "play/faulty_environments": len(self._faulty),
            "play/faulty_actors": f"{told} and {more} more" if more > 0 else told,
        }

    def _is_faulty(self, newest: deque[ChunkStatistics]) -> bool:
        if len(newest) < _LEAST:
            return False
        healthy = [sum(each.valid for each in newest), sum(each.follows for each in newest)]
        if self._keys_can_follow:
            healthy.append(sum(each.matched for each in newest))
        return min(healthy) < LEAST_SHARE * sum(each.steps for each in newest)
