"""The base class of everything that takes a run's figures: files, other programs, the terminal."""

import time
from pathlib import Path

from common.run.epochs import EpochRow
from common.schedule import Now
from learner.telemetry.live_feed import LiveFeed
from learner.telemetry.snapshot import Snapshot


class Sink:
    """Receives snapshots and events; a subclass overrides the methods that it needs."""

    period = 10.0
    """Seconds between two snapshots."""

    def watch(self, feed: LiveFeed) -> None:
        """Takes the feed that answers what actors show; called before `start`."""

    def start(self, resumed_at: int | None) -> None:
        """Opens the files or programs that the sink writes to.

        Args:
            resumed_at: agent steps of the resumed checkpoint; data written after it is dropped.
                None for a new run.
        """

    def write(self, snapshot: Snapshot) -> None:
        """Takes the present figures."""

    def phase(self, row: EpochRow, agent_steps: int) -> None:
        """Keeps the figures of a finished phase for the next `write`; its weights had
        ``agent_steps``. It must not raise OSError: the phase is recorded already, and would be
        recorded again.
        """

    def filmed(self, file: Path, agent_steps: int) -> None:
        """Takes a film of an epoch's network, whose weights had ``agent_steps``; the film of epoch
        0 shows the warm-up."""

    def event(self, text: str) -> None:
        """Takes an event, which later snapshots have among their notes."""

    def line(self, text: str) -> None:
        """Takes a sentence for people, such as where the run's files are, or a warning."""

    def close(self) -> None:
        """Closes the sink, after the last figures were written."""


class LatestSink(Sink):
    """Keeps the latest snapshot, and answers from any thread."""

    period = 1.0

    def __init__(self, now: Now = time.monotonic) -> None:
        self._now = now
        self._looked = now()
        self._latest: Snapshot | None = None

    def write(self, snapshot: Snapshot) -> None:
        self._latest, self._looked = snapshot, self._now()

    def _silent_for(self) -> float:
        """Returns the seconds since the training loop last delivered a snapshot."""
        return self._now() - self._looked
