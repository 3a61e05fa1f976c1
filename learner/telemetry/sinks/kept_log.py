"""Who came, left, or was lost, and what else was said, in the log that the run keeps."""

from collections.abc import Callable

from learner.telemetry.sinks.sink import Sink


class KeptLogSink(Sink):
    """Gives events and sentences to ``keep``, see `common.process.log_lines.kept_log`."""

    def __init__(self, keep: Callable[[str], None]) -> None:
        self._keep = keep

    def event(self, text: str) -> None:
        self._keep(text)

    line = event
