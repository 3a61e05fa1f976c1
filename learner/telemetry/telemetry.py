"""`Telemetry`: everything that the training loop tells of itself, and when it is shown where."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from learner.algorithm.interface import DeviceBatch, Update
from learner.clock import Every
from learner.telemetry.monitor import Monitor
from learner.telemetry.records import Records
from learner.telemetry.running_means import RunningMeans
from learner.telemetry.sinks.display import Display
from learner.telemetry.status import Gate, Phase, Status
from replay.chunk_statistics import Progress

_SHOW = 1.0
_CURVE_POINT = 10.0
_SUMMARY = 60.0


class Moment(NamedTuple):
    """What the training loop knows of itself."""

    progress: Progress
    """The replay's."""
    phase: Phase
    updates: int
    weights_version: int
    """Newest weights that were published."""
    max_q: tuple[float, float] | None
    """Mean and standard deviation over the held-out states; None before there are any."""


class Telemetry:
    """Gathers the run's figures, and hands them to screen, curves and summary by schedule."""

    def __init__(
        self,
        monitor: Monitor,
        records: Records,
        display: Display,
        means: RunningMeans,
        now: Callable[[], float],
    ) -> None:
        self._monitor = monitor
        self._records = records
        self._display = display
        self._means = means
        self._show = Every(_SHOW, now)
        self._point = Every(_CURVE_POINT, now)
        self._summarise = Every(_SUMMARY, now)

    def update(self, batch: DeviceBatch, result: Update) -> None:
        """Take in one update."""
        self._means.add(batch, result)

    def note(self, text: str) -> None:
        """Remember an event for the display."""
        self._monitor.note(text)

    def say(self, text: str) -> None:
        """Show a sentence that stays."""
        self._display.line(text)

    def report(self, moment: Moment) -> Sequence[Gate]:
        """Show the run as it is now where that is due; returns its gates."""
        status = self._status(moment)
        if self._show.is_due():
            self._display.show(status)
        if self._point.is_due():
            self._records.point(status)
        if self._summarise.is_due():
            self._records.summarise(status)
        return status.gates

    def close(self, moment: Moment) -> None:
        """Write the last summary."""
        self._records.summarise(self._status(moment))
        self._records.close()

    def _status(self, moment: Moment) -> Status:
        return self._monitor.status(*moment)
