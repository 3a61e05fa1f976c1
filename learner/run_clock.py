"""The run's clock, which stands still while nobody trains."""

import time

from common.schedule import Now


class RunClock:
    """A clock of the seconds of work on a run, including those before a resume."""

    def __init__(self, now: Now = time.monotonic) -> None:
        self.now = now
        self._zero = now()

    def seconds(self) -> float:
        """Returns the wall-clock seconds for which the run has been worked on."""
        return self.now() - self._zero

    def restore(self, seconds: float) -> None:
        """Continues a run that has been worked on for ``seconds``."""
        self._zero = self.now() - seconds
