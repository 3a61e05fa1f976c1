"""``--track``: the run's curves and settings for a program that compares runs.

Where it keeps them, and whether anything leaves this machine, is that program's own matter:
``WANDB_MODE=offline``, ``MLFLOW_TRACKING_URI``, ``TRACKIO_DIR``. A tracker that fails is given up
with a warning; the run goes on.
"""

import logging
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from common.metrics import Value, Values
from common.process.extras import extra_for
from learner.telemetry.sinks.curves import CurvesSink

TrackerName = Literal["wandb", "mlflow", "trackio"]
PROJECT = "ale-robot"
_STEPS = "agent_steps"
_log = logging.getLogger(__name__)


class Tracker(Protocol):
    """A program that keeps the curves of one run."""

    def log(self, points: Mapping[str, float], agent_steps: int) -> None:
        """Add a point to each of some curves; steps may go back, to those of a test's weights."""

    def close(self) -> None:
        """Finish the run."""


@dataclass(frozen=True)
class TrackedRun:
    """What a tracker knows of a run."""

    name: str
    identity: str
    """Stays the same over restarts, and differs from that of any other run."""
    settings: Mapping[str, Value]
    """By their flags, as ``learning.n_step``."""


class Wandb:
    """Weights & Biases."""

    def __init__(self, run: TrackedRun) -> None:
        import wandb

        self._run = wandb.init(
            project=PROJECT,
            name=run.name,
            id=run.identity,
            resume="allow",
            config=dict(run.settings),
            settings=wandb.Settings(silent=True),
        )
        # Not its own step, which may not go back.
        self._run.define_metric(_STEPS)
        self._run.define_metric("*", step_metric=_STEPS)

    def log(self, points: Mapping[str, float], agent_steps: int) -> None:
        self._run.log({_STEPS: agent_steps, **points})

    def close(self) -> None:
        self._run.finish()


class Mlflow:
    """MLflow."""

    _TAG = "ale_robot.run"

    def __init__(self, run: TrackedRun) -> None:
        # The training loop waits for each point; MLflow's own patience is minutes.
        os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "5")
        os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "1")
        import mlflow

        self._mlflow = mlflow
        mlflow.set_experiment(PROJECT)
        found: Any = mlflow.search_runs(
            filter_string=f"tags.`{self._TAG}` = '{run.identity}'", output_format="list"
        )
        if found:
            mlflow.start_run(run_id=found[0].info.run_id)
        else:
            mlflow.start_run(run_name=run.name, tags={self._TAG: run.identity})
            mlflow.log_params(dict(run.settings))

    def log(self, points: Mapping[str, float], agent_steps: int) -> None:
        self._mlflow.log_metrics(dict(points), step=agent_steps)

    def close(self) -> None:
        self._mlflow.end_run()


class Trackio:
    """Trackio."""

    def __init__(self, run: TrackedRun) -> None:
        import trackio

        self._trackio = trackio
        # It knows a run by its name alone.
        name = f"{run.name}-{run.identity[:8]}"
        trackio.init(
            project=PROJECT,
            name=name,
            config=dict(run.settings),
            resume="allow",
            auto_log_gpu=False,
        )

    def log(self, points: Mapping[str, float], agent_steps: int) -> None:
        self._trackio.log(dict(points), step=agent_steps)

    def close(self) -> None:
        self._trackio.finish()


TRACKERS: dict[TrackerName, Callable[[TrackedRun], Tracker]] = {
    "wandb": Wandb,
    "mlflow": Mlflow,
    "trackio": Trackio,
}


class TrackerSink(CurvesSink):
    """Gives a run's curves to the tracker called ``name``.

    Raises:
        InputError: it is not installed.
    """

    def __init__(self, name: TrackerName, run: TrackedRun) -> None:
        self._name = name
        with extra_for(f"--track {name}", name):
            self._tracker: Tracker | None = None
            try:
                self._tracker = TRACKERS[name](run)
            except ModuleNotFoundError:
                raise
            except Exception as error:  # a run is worth more than its curves elsewhere
                self._give_up(error)

    def add(self, points: Values, agent_steps: int) -> None:
        """See `CurvesSink.add`."""
        known = {tag: float(value) for tag, value in points.items() if value is not None}
        self._try(lambda tracker: tracker.log(known, agent_steps))

    def close(self) -> None:
        """Finish the tracked run."""
        self._try(lambda tracker: tracker.close())

    def _try(self, act: Callable[[Tracker], None]) -> None:
        if self._tracker is None:
            return
        try:
            act(self._tracker)
        except Exception as error:
            self._give_up(error)

    def _give_up(self, error: Exception) -> None:
        self._tracker = None
        _log.warning("--track %s is given up, and the run goes on: %s", self._name, error)
