"""The phases of a run: warm-up, then one epoch after another, and the tests of their snapshots."""

import math
from typing import Any

from torch import Tensor

from common.run.config import RunConfig
from learner.clock import RunClock
from learner.evaluation.coordinator import EpochTest
from learner.telemetry.run_progress import PhaseEnd, RunProgress
from learner.telemetry.sinks.epochs_csv import EpochRow
from learner.telemetry.telemetry import Telemetry


class Phases:
    """Counts updates into phases and records a row for each phase and test that ended.

    Args:
        progress: counts agent steps and games into the same phases.
    """

    def __init__(
        self, config: RunConfig, progress: RunProgress, telemetry: Telemetry, clock: RunClock
    ) -> None:
        self._config = config
        self._progress = progress
        self._telemetry = telemetry
        self._clock = clock
        self.updates = 0
        """Updates of the whole run."""
        self._phase_updates = 0
        self._loss: Tensor | float = 0.0  # a sum on the device, so that no update waits for it
        self._began = 0.0

    def add(self, loss: Tensor) -> None:
        """Count one update."""
        self.updates += 1
        self._phase_updates += 1
        self._loss += loss.float()

    @property
    def is_finite(self) -> bool:
        """Whether all losses of this phase were; one that was not stays in their sum."""
        return math.isfinite(float(self._loss))

    def end(self, ended: PhaseEnd, stored: int, meanq: float | None) -> EpochTest | None:
        """Record a phase and start the next; returns the test that an epoch calls for.

        Args:
            stored: steps in the replay.
            meanq: mean max-Q over the held-out states.
        """
        config, progress = self._config, self._progress
        now = self._clock.seconds()
        train_steps = progress.train_steps if ended.epoch else 0
        self._telemetry.add(
            EpochRow.of_games(
                ended.scores,
                epoch=ended.epoch,
                phase="train" if ended.epoch or config.exploration.start < 1 else "random",
                steps=ended.steps,
                last_exploration_rate=config.epsilon_at(progress.agent_steps),
                total_train_steps=train_steps,
                replay_memory_count=stored,
                meanq=meanq,
                meancost=float(self._loss) / max(self._phase_updates, 1),
                weight_updates=self.updates,
                total_time=now,
                epoch_time=now - self._began,
            )
        )
        self._began = now
        self._phase_updates = 0
        self._loss = 0.0
        if not ended.epoch:
            return None
        return EpochTest(
            epoch=ended.epoch,
            weight_updates=self.updates,
            total_train_steps=train_steps,
            replay_memory_count=stored,
            meanq=meanq,
            remaining=config.protocol.test_steps,
        )

    def record(self, test: EpochTest) -> float | None:
        """Record a test that is over; returns the best mean score of the tests before it."""
        best = max(self._telemetry.rewards("test"), default=None)
        now = self._clock.seconds()
        self._telemetry.add(
            EpochRow.of_games(
                test.scores,
                epoch=test.epoch,
                phase="test",
                steps=test.steps,
                last_exploration_rate=self._config.protocol.test_epsilon,
                total_train_steps=test.total_train_steps,
                replay_memory_count=test.replay_memory_count,
                meanq=test.meanq,
                meancost=0.0,
                weight_updates=test.weight_updates,
                total_time=now,
                epoch_time=now - (test.began if test.began is not None else now),
            )
        )
        return best

    def state(self) -> dict[str, Any]:
        """Everything, of JSON's types."""
        return {
            "updates": self.updates,
            "phase_updates": self._phase_updates,
            "phase_loss": float(self._loss),
            "phase_began": self._began,
            "rows": len(self._telemetry.rows),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from what `state` returned; the rows are restored by their table."""
        self.updates = int(state["updates"])
        self._phase_updates = int(state["phase_updates"])
        self._loss = float(state["phase_loss"])
        self._began = float(state["phase_began"])
