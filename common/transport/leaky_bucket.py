"""`LeakyBucket`: limits how much is accepted from each process, however many others send too."""

import time

from common.schedule import Now
from common.transport.access_control import MAX_SESSIONS

ACTOR_QUOTA = 10_000
"""Agent steps per second that are accepted from one actor, the default of ``--actor-quota``: four
times as many as an ALE-Only actor makes on one core."""
REPORTS_PER_SECOND = 2_000
"""Reports that are accepted from one evaluator. Catch, the shortest game, ends after six steps, and
an evaluator plays some 300 games of it per second."""
NEW_NAMES_PER_SECOND = 256.0
"""New names that are accepted. A thousand robots that begin together bring 240 per second, because
each sends its first chunk of 64 steps within 4.3 s. A client that invents a name for each chunk can
send less than two actors may."""
_NAMES_AMOUNT = 64.0
"""Steps or reports that one new name may bring; one that brings more counts as several names."""
_AHEAD = 1.0
"""Amount that may come at once, in seconds of the quota, as after a pause of the hub."""
_MAX_NAMES = MAX_SESSIONS
"""Maximum number of names with a bucket of their own."""
_FORGOTTEN = 60.0
"""Seconds of silence after which a new name may take a name's place."""


class LeakyBucket:
    """Leaky buckets that admit so much per second from each name, and so many new names. They are
    for one thread.

    What is refused should be sent again; it uses none of its sender's quota. A name in use keeps
    its bucket, however many names others invent.
    """

    def __init__(self, per_second: float, now: Now = time.monotonic) -> None:
        self._per_second = per_second
        self._now = now
        self._paid_until: dict[str, float] = {}
        """By name, the time until which the admitted amount uses up the quota."""
        self._joined_until = -float("inf")
        """The same for all new names together."""
        self._last = ("", 0.0, False)
        """The name that was admitted last, the amount, and whether the name was new."""

    def knows(self, name: str) -> bool:
        """Whether ``name`` has a bucket of its own."""
        return name in self._paid_until

    def admits(self, name: str, amount: float = 1.0) -> bool:
        """Whether ``amount`` from ``name`` is admitted now; it may exceed a second's quota."""
        now, new = self._now(), not self.knows(name)
        if new and not self._lets_in(now, amount):
            return False
        begins = max(self._paid_until.get(name, now), now)
        if begins - now > _AHEAD:
            return False
        self._paid_until[name] = begins + amount / self._per_second
        self._last = name, amount, new
        return True

    def charge(self, name: str, whole: float) -> None:
        """Counts what was admitted last as ``whole``, if it was of ``name`` and held more than had
        been known."""
        admitted, amount, new = self._last
        if name != admitted or whole <= amount:
            return
        self._paid_until[name] += (whole - amount) / self._per_second
        if new:
            more = _counts_as_names(whole) - _counts_as_names(amount)
            self._joined_until += more / NEW_NAMES_PER_SECOND

    def _lets_in(self, now: float, amount: float) -> bool:
        """Whether a new name, which brings ``amount``, may have a bucket of its own."""
        begins = max(self._joined_until, now)
        if begins - now > _AHEAD:
            return False
        self._joined_until = begins + _counts_as_names(amount) / NEW_NAMES_PER_SECOND
        if len(self._paid_until) >= _MAX_NAMES:
            heard = {n: until for n, until in self._paid_until.items() if until > now - _FORGOTTEN}
            self._paid_until = heard
        return len(self._paid_until) < _MAX_NAMES


def _counts_as_names(amount: float) -> float:
    """Returns as how many new names one that brings ``amount`` counts."""
    return max(amount / _NAMES_AMOUNT, 1.0)
