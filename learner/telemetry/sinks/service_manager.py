"""Tells the service manager that the training loop goes round, and where it is."""

from common.process.service_manager import tell
from learner.telemetry.sinks.display import status_line
from learner.telemetry.sinks.sink import Sink
from learner.telemetry.snapshot import Snapshot


class ServiceManagerSink(Sink):
    """``systemctl status`` shows its line."""

    period = 5.0

    def write(self, snapshot: Snapshot) -> None:
        tell("READY=1", f"STATUS={status_line(snapshot)}", "WATCHDOG=1")

    def close(self) -> None:
        tell("STOPPING=1")
