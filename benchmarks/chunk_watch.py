"""`ChunkWatch`: chunks as a replay elsewhere accepts them, seen from outside."""

import time
from collections.abc import Callable

from replay.chunk_statistics import ChunkStatistics
from replay.client import RemoteReplay

_POLL = 0.02


class ChunkWatch:
    """Asks a replay over and over for what is new."""

    def __init__(self, replay: RemoteReplay) -> None:
        self._replay = replay
        self._seen = 0

    def next(self, check: Callable[[], None]) -> tuple[float, tuple[ChunkStatistics, ...]]:
        """The moment at which chunks are first seen, and their facts; one chunk or more.

        Args:
            check: raises where none will come any more.
        """
        while True:
            facts = self._replay.progress(self._seen).facts
            now = time.monotonic()
            check()
            if facts:
                self._seen = facts[-1].index + 1
                return now, facts
            time.sleep(_POLL)
