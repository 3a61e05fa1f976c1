"""How the learner tells time: the run's own clock, and what is due by a clock."""

import time
from collections.abc import Callable

Now = Callable[[], float]
"""Returns monotonic seconds."""


class RunClock:
    """Seconds of work on a run, those before a resume included."""

    def __init__(self, now: Now = time.monotonic) -> None:
        self.now = now
        self._zero = now()

    def seconds(self) -> float:
        """Returns the wall-clock seconds for which the run has been worked on."""
        return self.now() - self._zero

    def restore(self, seconds: float) -> None:
        """Continue a run that had been worked on for so long."""
        self._zero = self.now() - seconds


class Every:
    """A schedule: due at once, then again each time ``seconds`` have passed."""

    def __init__(self, seconds: float, now: Now) -> None:
        self._seconds = seconds
        self._now = now
        self._next = -float("inf")

    def is_due(self) -> bool:
        """Whether the time has come; asking then starts the next period."""
        due = self._now() >= self._next
        if due:
            self.restart()
        return due

    def hasten(self) -> None:
        """Be due at once, because what is scheduled could not be done."""
        self._next = -float("inf")

    def restart(self) -> None:
        """Start a period now, because what is scheduled was just done."""
        self._next = self._now() + self._seconds
