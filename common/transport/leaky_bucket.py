"""`LeakyBucket`: how much of what one process sends is taken, however many others send too."""

import time
from collections.abc import Callable

from common.transport.access_control import MOST_SESSIONS

STEPS_PER_SECOND = 10_000
"""Agent steps that are taken of one actor, unless ``--actor-quota`` says otherwise: three times as
many as an ALE-Only actor makes on one core."""
REPORTS_PER_SECOND = 2_000
"""Reports that are taken of one evaluator. Catch, the shortest game, ends after six steps, and an
evaluator makes some 300 of its games a second."""
NEW_NAMES_PER_SECOND = 256.0
"""Names that are heard for the first time. A thousand robots that begin together bring 240, for
each sends its first chunk of 64 steps within 4.3 s. Who invents a name for each chunk sends less
than two actors may."""
_NAMES_AMOUNT = 64.0
"""Steps or reports that a new name may bring; who brings more counts as more names."""
_AHEAD = 1.0
"""Seconds of its quota that may come at once, as after a pause of the hub."""
_MOST_NAMES = MOST_SESSIONS
"""Names that have a measure of their own."""
_FORGOTTEN = 60.0
"""Seconds of silence after which a name may give its place to a new one."""


class LeakyBucket:
    """Admits so much a second of each name, and so many new names; leaky buckets, for one thread.

    What is turned away should be sent again: it costs its sender nothing of the quota. A name that
    is in use keeps its measure, however many names others invent.
    """

    def __init__(self, per_second: float, now: Callable[[], float] = time.monotonic) -> None:
        self._per_second = per_second
        self._now = now
        self._paid_until: dict[str, float] = {}
        """By name, the moment at which what was admitted has had its time."""
        self._joined_until = -float("inf")
        """The same of all new names together."""

    def knows(self, name: str) -> bool:
        """Whether ``name`` has a measure of its own."""
        return name in self._paid_until

    def admits(self, name: str, amount: float = 1.0) -> bool:
        """Whether ``amount`` of ``name`` may come in now; it may be more than a second's."""
        now = self._now()
        if not self.knows(name) and not self._lets_in(now, amount):
            return False
        begins = max(self._paid_until.get(name, now), now)
        if begins - now > _AHEAD:
            return False
        self._paid_until[name] = begins + amount / self._per_second
        return True

    def _lets_in(self, now: float, amount: float) -> bool:
        """Whether another name, which brings ``amount``, may have a measure of its own."""
        begins = max(self._joined_until, now)
        if begins - now > _AHEAD:
            return False
        names = max(amount / _NAMES_AMOUNT, 1.0)
        self._joined_until = begins + names / NEW_NAMES_PER_SECOND
        if len(self._paid_until) >= _MOST_NAMES:
            heard = {n: until for n, until in self._paid_until.items() if until > now - _FORGOTTEN}
            self._paid_until = heard
        return len(self._paid_until) < _MOST_NAMES
