"""The run's curves for TensorBoard, over agent steps.

Written with TensorBoard's own event writer: PyTorch's wrapper around it takes seconds to import
and brings nothing that scalars need.
"""

import time
from pathlib import Path

from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.event_file_writer import EventFileWriter

from common.metrics import Values
from learner.telemetry.sinks.curves import CurvesSink

_FLUSH_SECONDS = 10


class TensorBoardSink(CurvesSink):
    """Event files in ``folder``, made when it does not exist; earlier files in it stay."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def start(self, resumed_at: int | None) -> None:
        """Open a file; TensorBoard forgets the points after ``resumed_at``."""
        self._writer = EventFileWriter(str(self._folder), flush_secs=_FLUSH_SECONDS)
        if resumed_at is not None:
            restart = SessionLog(status=SessionLog.START)
            self._writer.add_event(
                Event(wall_time=time.time(), step=resumed_at + 1, session_log=restart)
            )
            self._writer.flush()

    def close(self) -> None:
        """Write what is still in memory and end."""
        self._writer.close()

    def add(self, points: Values, agent_steps: int) -> None:
        """See `CurvesSink.add`."""
        values = [
            Summary.Value(tag=tag, simple_value=value)
            for tag, value in points.items()
            if value is not None
        ]
        self._writer.add_event(
            Event(wall_time=time.time(), step=agent_steps, summary=Summary(value=values))
        )
