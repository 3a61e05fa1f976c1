"""Latency of the hands, recently and over the whole run, from counts that only grow."""

import dataclasses
import time
from collections import deque
from operator import sub

from common.metrics import Value
from common.press_latency import KeyLatency
from common.schedule import Now

WINDOW = 60.0
"""Seconds that count as recent."""
LEAST_MEASURED = 100
"""Minimum number of commands for a 99th percentile; with fewer it is the slowest of them."""


class RecentLatency:
    """Remembers the counts of the last `WINDOW` seconds, and computes percentiles."""

    def __init__(self, now: Now = time.monotonic) -> None:
        self._now = now
        self._ticks: deque[tuple[float, tuple[int, ...]]] = deque()

    def values(self, counts: tuple[int, ...]) -> dict[str, Value]:
        """Takes the run's present counts, empty if there are none yet; returns percentiles.

        ``run/…`` are over the whole run. ``hands/…`` are recent, or over the whole run if too few
        recent commands were measured.
        """
        now = self._now()
        self._ticks.append((now, counts))
        while now - self._ticks[0][0] > WINDOW:
            self._ticks.popleft()
        before = self._ticks[0][1]
        recent = tuple(map(sub, counts, before)) if before else counts
        values: dict[str, Value] = {}
        for goal in ("press", "release"):
            whole, late = KeyLatency.of(counts, goal), KeyLatency.of(recent, goal)
            late = late if late.measured >= LEAST_MEASURED else whole
            for name, value in dataclasses.asdict(whole).items():
                values[f"run/{goal}_{name}"] = value
                values[f"hands/{goal}_{name}"] = getattr(late, name)
        return values
