"""The run's own clock."""

import time

from common.schedule import Now


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
