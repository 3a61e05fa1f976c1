"""The run's curves for TensorBoard, over agent steps.

Written with TensorBoard's own event writer: PyTorch's wrapper around it takes seconds to import
and brings nothing that scalars need.
"""

import time
from pathlib import Path

from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.event_file_writer import EventFileWriter

from common.metrics import METRICS, Values, number
from learner.telemetry.sinks.epochs_csv import EpochRow
from learner.telemetry.sinks.sink import Sink
from learner.telemetry.snapshot import Snapshot

_FLUSH_SECONDS = 10


class TensorBoardSink(Sink):
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

    def write(self, snapshot: Snapshot) -> None:
        """One point on each live curve."""
        values = snapshot.values
        self._add(
            {
                tag: number(values, metric.key)
                for metric in METRICS.values()
                for tag in (
                    metric.key if metric.curve else "",
                    metric.gate and "gates/" + metric.gate,
                )
                if tag
            },
            int(number(values, "run/agent_steps") or 0),
        )

    def phase(self, row: EpochRow, agent_steps: int) -> None:
        """The figures of a finished phase, at the agent steps of the weights that played it.

        ``agent_steps`` counts the warm-up as every other curve does; the row's
        ``total_train_steps`` does not.
        """
        self._add(
            {
                f"play/epoch_{row.phase}_reward": row.average_reward,
                f"play/epoch_{row.phase}_min": row.min_game_reward,
                f"play/epoch_{row.phase}_max": row.max_game_reward,
                f"play/epoch_{row.phase}_steps_per_second": row.steps_per_second,
                f"learning/epoch_{row.phase}_mean_max_q": row.meanq,
                f"learning/epoch_{row.phase}_loss": row.meancost if row.phase == "train" else None,
            },
            agent_steps,
        )

    def close(self) -> None:
        """Write what is still in memory and end."""
        self._writer.close()

    def _add(self, points: Values, agent_steps: int) -> None:
        values = [
            Summary.Value(tag=tag, simple_value=value)
            for tag, value in points.items()
            if value is not None
        ]
        self._writer.add_event(
            Event(wall_time=time.time(), step=agent_steps, summary=Summary(value=values))
        )
