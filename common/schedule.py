"""What is due by a clock."""

from collections.abc import Callable

Now = Callable[[], float]
"""Returns monotonic seconds."""


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
