"""What takes a run's figures: a file, a program beside it, or the terminal."""

import time
from pathlib import Path

from common.run.epochs import EpochRow
from common.schedule import Now
from learner.telemetry.live_feed import LiveFeed
from learner.telemetry.snapshot import Snapshot


class Sink:
    """Takes a snapshot now and then; a sink overrides what it needs."""

    period = 10.0
    """Seconds between two snapshots."""

    def watch(self, feed: LiveFeed) -> None:
        """Take where to ask for what actors show, before `start`."""

    def start(self, resumed_at: int | None) -> None:
        """Open what it writes to.

        Args:
            resumed_at: agent steps of the checkpoint that was resumed: what was written after it
                is dropped. None for a new run.
        """

    def write(self, snapshot: Snapshot) -> None:
        """Take the figures as they are."""

    def phase(self, row: EpochRow, agent_steps: int) -> None:
        """Take the figures of a finished phase, whose weights are ``agent_steps`` old."""

    def filmed(self, file: Path, agent_steps: int) -> None:
        """Take a film of an epoch's network at play, whose weights are ``agent_steps`` old; of
        epoch 0 it is the warm-up's play."""

    def event(self, text: str) -> None:
        """Take notice of an event, which snapshots have among their notes from now on."""

    def line(self, text: str) -> None:
        """Take a sentence for people, such as where the run's files are, or a warning."""

    def close(self) -> None:
        """End; the last figures were written."""


class LatestSink(Sink):
    """Keeps the latest snapshot for those who ask, from any thread."""

    period = 1.0

    def __init__(self, now: Now = time.monotonic) -> None:
        self._now = now
        self._looked = now()
        self._latest: Snapshot | None = None

    def write(self, snapshot: Snapshot) -> None:
        self._latest, self._looked = snapshot, self._now()

    def _silent_for(self) -> float:
        """Seconds since the training loop last looked around."""
        return self._now() - self._looked
