"""`CurvesSink`: a run's curves, histograms and films over agent steps, for programs that draw
curves."""

from abc import abstractmethod
from collections.abc import Mapping

from common.metrics import METRICS, Metric, Values, number
from common.run.epochs import EpochRow
from learner.telemetry.sinks.sink import Sink
from learner.telemetry.snapshot import Histogram, Snapshot

FILM = "play/film"
"""Name of the films."""


def tags_of(metric: Metric) -> list[str]:
    """Returns the names of a figure's curves; none if it is not drawn."""
    gate = [f"gates/{metric.gate}"] if metric.gate else []
    return [metric.key, *gate] if metric.curve else gate


class CurvesSink(Sink):
    """A sink that turns snapshots into points of curves; a subclass hands them to its program."""

    @abstractmethod
    def add(self, points: Values, agent_steps: int) -> None:
        """Takes one point of each curve; None stands for an unknown value."""

    @abstractmethod
    def add_histograms(self, found: Mapping[str, Histogram], agent_steps: int) -> None:
        """Takes histograms by their names."""

    def write(self, snapshot: Snapshot) -> None:
        """Adds one point to each live curve, and the histograms."""
        values = snapshot.values
        agent_steps = int(number(values, "run/agent_steps") or 0)
        self.add(
            {
                tag: number(values, metric.key)
                for metric in METRICS.values()
                for tag in tags_of(metric)
            },
            agent_steps,
        )
        self.add_histograms(snapshot.histograms, agent_steps)

    def phase(self, row: EpochRow, agent_steps: int) -> None:
        """Adds the figures of a finished phase, at the agent steps of the weights that played it.

        ``agent_steps`` includes the warm-up, as in every other curve; the row's
        ``total_train_steps`` does not.
        """
        self.add(
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
