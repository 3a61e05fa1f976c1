"""How long the hands take, of late and over the whole run, from counts that only grow."""

import time
from collections import deque
from collections.abc import Callable
from operator import sub

from common.press_latency import Delay, Goal

WINDOW = 60.0
"""Seconds that count as of late."""
LEAST_MEASURED = 100
"""Of fewer commands the 99th percentile is but the slowest."""


class RecentLatency:
    """Remembers the counts of the last while.

    Args:
        clock: monotonic seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._ticks: deque[tuple[float, tuple[int, ...]]] = deque()

    def look(self, counts: tuple[int, ...]) -> None:
        """Take in the run's counts as they are now; empty while nobody has told any."""
        now = self._clock()
        self._ticks.append((now, counts))
        while now - self._ticks[0][0] > WINDOW:
            self._ticks.popleft()

    def in_all(self, goal: Goal) -> Delay:
        """Over the run, up to the last look."""
        return Delay.of(self._ticks[-1][1], goal)

    def of_late(self, goal: Goal) -> Delay:
        """Over the last while, or over the run where that is too little to tell."""
        before, counts = self._ticks[0][1], self._ticks[-1][1]
        recent = tuple(map(sub, counts, before)) if before else counts
        found = Delay.of(recent, goal)
        return found if found.measured >= LEAST_MEASURED else self.in_all(goal)
