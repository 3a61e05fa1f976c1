"""Writes arrivals, losses and other messages to the log in the run's folder."""

from collections.abc import Callable

from learner.telemetry.sinks.sink import Sink


class KeptLogSink(Sink):
    """Hands events and sentences to ``keep``, see `common.process.log_lines.kept_log`."""

    def __init__(self, keep: Callable[[str], None]) -> None:
        self._keep = keep

    def event(self, text: str) -> None:
        self._keep(text)

    line = event
