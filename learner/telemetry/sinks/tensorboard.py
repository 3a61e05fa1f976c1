"""The run's curves for TensorBoard, over agent steps.

Written with TensorBoard's own event writer: PyTorch's wrapper around it takes seconds to import
and brings nothing that scalars need. Each tag has one source, so no curve is drawn twice.
"""

import time
from pathlib import Path
from typing import Self

from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.event_file_writer import EventFileWriter

from learner.telemetry.sinks.epochs_csv import EpochRow
from learner.telemetry.status import Status

_FLUSH_SECONDS = 10


class Curves:
    """Event files in ``folder``; a context manager.

    Args:
        folder: made when it does not exist; earlier files in it stay.
        resumed_at: agent steps of the checkpoint that was resumed, whose later points, of a
            life that was lost, TensorBoard then forgets. None for a new run.
    """

    def __init__(self, folder: Path, resumed_at: int | None = None) -> None:
        self._writer = EventFileWriter(str(folder), flush_secs=_FLUSH_SECONDS)
        if resumed_at is not None:
            restart = SessionLog(status=SessionLog.START)
            self._writer.add_event(
                Event(wall_time=time.time(), step=resumed_at + 1, session_log=restart)
            )
            self._writer.flush()

    def status(self, status: Status) -> None:
        """One point on each live curve, at the status' agent steps."""
        chunks = status.chunks
        points: dict[str, float | None] = {
            "play/train_reward": status.train_reward,
            "play/games": status.games,
            "learning/epsilon": status.epsilon,
            "learning/loss": status.loss,
            "learning/mean_max_q": status.mean_max_q,
            "learning/held_out_std": status.held_out_std,
            "learning/updates": status.updates,
            "learning/updates_per_second": status.updates_per_second,
            "stream/steps_per_second": status.steps_per_second,
            "stream/samples_per_insert": status.samples_per_insert,
            "stream/staleness_p50": status.staleness_p50,
            "stream/staleness_p95": status.staleness_p95,
            "stream/weights_version": status.weights_version,
            "stream/stored": status.stored,
            "stream/actors_alive": sum(actor.alive for actor in status.actors),
            "stream/chunks_made": chunks.made,
            "stream/chunks_acked": chunks.acked,
            "stream/chunks_retried": chunks.retried,
            "stream/chunks_duplicate": chunks.duplicate,
            "stream/chunks_refused": chunks.refused,
            "gates/failed": len(status.failed_gates),
            **{f"gates/{name}": value for name, value in status.gate_figures.items()},
        }
        self._add(points, status.agent_steps)

    def epoch(self, row: EpochRow, agent_steps: int) -> None:
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

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _add(self, points: dict[str, float | None], agent_steps: int) -> None:
        values = [
            Summary.Value(tag=tag, simple_value=value)
            for tag, value in points.items()
            if value is not None
        ]
        self._writer.add_event(
            Event(wall_time=time.time(), step=agent_steps, summary=Summary(value=values))
        )
