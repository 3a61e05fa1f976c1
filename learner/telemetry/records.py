"""Writes down phases and status: the rows, the curves, the summary."""

from common.run.config import RunConfig
from common.run.folder import RunFolder
from learner.telemetry.provenance import Provenance
from learner.telemetry.sinks.epochs_csv import EpochRow, EpochTable
from learner.telemetry.sinks.gates_csv import GateTable
from learner.telemetry.sinks.summary import write_summary
from learner.telemetry.sinks.tensorboard import Curves
from learner.telemetry.status import ClockMode, Status


class Records:
    """All that a run leaves for its readers, but for checkpoints and snapshots.

    Args:
        rows: how many rows the resumed checkpoint knows of; 0 for a new run.
        agent_steps: those of the checkpoint; None for a new run.
        clock: how time passes for local mode's actors, for the summary.
    """

    def __init__(
        self,
        folder: RunFolder,
        config: RunConfig,
        rows: int,
        agent_steps: int | None,
        clock: ClockMode | None,
    ) -> None:
        self._folder = folder
        self._config = config
        self._clock = clock
        self._table = EpochTable(folder.epochs)
        self.rows = self._table.keep(rows)
        self._curves = Curves(folder.tensorboard, agent_steps)
        self._gates = GateTable(folder.gates, agent_steps)
        self._provenance = Provenance.gather()

    def add(self, row: EpochRow) -> None:
        """A phase is complete."""
        self._table.append(row)
        self.rows.append(row)
        self._curves.epoch(row, row.total_train_steps + self._config.replay.learning_starts)

    def point(self, status: Status) -> None:
        """One point on each curve, and a row of gates."""
        self._curves.status(status)
        self._gates.add(status)

    def summarise(self, status: Status) -> None:
        """Write ``summary.json``."""
        write_summary(
            self._folder.summary,
            status,
            self._config,
            self._provenance,
            self._clock,
            initial=self._folder.initial.exists(),
            train_steps_per_second=self._rate("train"),
            test_steps_per_second=self._rate("test"),
        )

    def close(self) -> None:
        self._curves.close()

    def rewards(self, phase: str) -> tuple[float, ...]:
        """Mean scores of the phases of that kind in which a game ended, oldest first."""
        return tuple(
            row.average_reward
            for row in self.rows
            if row.phase == phase and row.average_reward is not None
        )

    def _rate(self, phase: str) -> float | None:
        rows = [row for row in self.rows if row.phase == phase]
        seconds = sum(row.epoch_time for row in rows)
        return sum(row.steps for row in rows) / seconds if seconds else None
