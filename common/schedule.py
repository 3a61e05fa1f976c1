"""A schedule of work that is due again after a period."""

from collections.abc import Callable

Now = Callable[[], float]
"""Returns monotonic seconds."""


class Every:
    """A schedule that is due at once, and again each time ``seconds`` have passed."""

    def __init__(self, seconds: float, now: Now) -> None:
        self._seconds = seconds
        self._now = now
        self._next = -float("inf")

    def is_due(self) -> bool:
        """Whether the work is due; if so, asking starts the next period."""
        due = self._now() >= self._next
        if due:
            self.restart()
        return due

    def hasten(self) -> None:
        """Makes the work due at once, because it could not be done."""
        self._next = -float("inf")

    def restart(self) -> None:
        """Starts a period now, because the work was just done."""
        self._next = self._now() + self._seconds
