"""`Quota`: how much of what one process sends is taken, however many others send too."""

import time
from collections.abc import Callable

STEPS_PER_SECOND = 10_000
"""Agent steps that are taken of one actor, unless ``--actor-quota`` says otherwise: three times as
many as an ALE-Only actor makes on one core."""
REPORTS_PER_SECOND = 2_000
"""Reports that are taken of one evaluator. Catch, the shortest game, ends after six steps, and an
evaluator makes some 300 of its games a second."""
_AHEAD = 1.0
"""Seconds of its quota that may come at once, as after a pause of the hub."""
_MOST_NAMES = 4_096


class Quota:
    """Admits so much a second of each name; a leaky bucket, for one thread.

    What is turned away should be sent again: it costs its sender nothing of the quota.
    """

    def __init__(self, per_second: float, now: Callable[[], float] = time.monotonic) -> None:
        self._per_second = per_second
        self._now = now
        self._paid_until: dict[str, float] = {}
        """By name, the moment at which what was admitted has had its time."""

    def admits(self, name: str, amount: float = 1.0) -> bool:
        """Whether ``amount`` of ``name`` may come in now; it may be more than a second's."""
        now = self._now()
        begins = max(self._paid_until.get(name, now), now)
        if begins - now > _AHEAD:
            return False
        if len(self._paid_until) >= _MOST_NAMES:
            self._paid_until.clear()  # who invents names has no measure anyway
        self._paid_until[name] = begins + amount / self._per_second
        return True
