"""Tells the service manager that the training loop works, and how far it is."""

from common.process.service_manager import tell
from learner.telemetry.sinks.display import status_line
from learner.telemetry.sinks.sink import Sink
from learner.telemetry.snapshot import Snapshot


class ServiceManagerSink(Sink):
    """Sends the status line that ``systemctl status`` shows, and feeds the watchdog."""

    period = 5.0

    def write(self, snapshot: Snapshot) -> None:
        tell("READY=1", f"STATUS={status_line(snapshot)}", "WATCHDOG=1")

    def close(self) -> None:
        tell("STOPPING=1")
