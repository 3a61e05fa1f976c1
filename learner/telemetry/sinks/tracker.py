"""``--track``: the run's curves and settings for a program that compares runs.

Where it keeps them, and whether anything leaves this machine, is that program's own matter:
``WANDB_MODE=offline``, ``MLFLOW_TRACKING_URI``, ``TRACKIO_DIR``. It has a thread of its own, so a
server that does not answer holds up nothing. A tracker that fails is given up with a warning, one
that is too slow loses points; the run goes on.
"""

import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from common.metrics import Value, Values
from common.process.extras import extra_for
from learner.telemetry.sinks.curves import CurvesSink

TrackerName = Literal["wandb", "mlflow", "trackio"]
PROJECT = "ale-robot"
_STEPS = "agent_steps"
_MOST_WAITING = 256
"""Points that a slow tracker may still have before it: several minutes of a run."""
_FAREWELL = 30.0
"""Seconds that a run waits at its end for a tracker."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class TrackedRun:
    """What a tracker knows of a run."""

    name: str
    identity: str
    """Stays the same over restarts, and differs from that of any other run."""
    settings: Mapping[str, Value]
    """By their flags, as ``learning.n_step``."""


class Tracker(Protocol):
    """A program that keeps the curves of one run; all but its creation on one thread."""

    def begin(self, run: TrackedRun) -> None:
        """Begin a run, or go on with it after a restart."""

    def log(self, points: Mapping[str, float], agent_steps: int) -> None:
        """Add a point to each of some curves; steps may go back, to those of a test's weights."""

    def close(self) -> None:
        """Finish the run."""


class Wandb:
    """Weights & Biases."""

    def __init__(self) -> None:
        import wandb

        self._wandb = wandb

    def begin(self, run: TrackedRun) -> None:
        wandb = self._wandb
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

    def __init__(self) -> None:
        import mlflow

        self._mlflow = mlflow

    def begin(self, run: TrackedRun) -> None:
        mlflow = self._mlflow
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

    def __init__(self) -> None:
        import trackio

        self._trackio = trackio

    def begin(self, run: TrackedRun) -> None:
        # It knows a run by its name alone.
        name = f"{run.name}-{run.identity[:8]}"
        self._trackio.init(
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


TRACKERS: dict[TrackerName, Callable[[], Tracker]] = {
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
        self._lost = 0
        with extra_for(f"--track {name}", name):
            tracker = TRACKERS[name]()
        self._points: queue.Queue[tuple[Mapping[str, float], int] | None]
        self._points = queue.Queue(_MOST_WAITING)
        # A daemon: what a hanging server still lacks must not keep the process.
        self._thread = threading.Thread(
            target=self._work, args=(tracker, run), name=f"track {name}", daemon=True
        )
        self._thread.start()

    def add(self, points: Values, agent_steps: int) -> None:
        """See `CurvesSink.add`."""
        known = {tag: float(value) for tag, value in points.items() if value is not None}
        if not self._thread.is_alive():
            return
        try:
            self._points.put_nowait((known, agent_steps))
        except queue.Full:
            self._lost += 1
            if self._lost == 1:
                _log.warning("--track %s is too slow: it loses points of this run", self._name)

    def close(self) -> None:
        """Finish the tracked run, in bounded time."""
        ends = time.monotonic() + _FAREWELL
        with contextlib.suppress(queue.Full):
            self._points.put(None, timeout=_FAREWELL)
        self._thread.join(max(ends - time.monotonic(), 0.0))
        if self._thread.is_alive():
            _log.warning("--track %s does not answer: its last points are lost", self._name)
        elif self._lost:
            _log.warning("--track %s lacks %d points of this run", self._name, self._lost)

    def _work(self, tracker: Tracker, run: TrackedRun) -> None:
        try:
            tracker.begin(run)
            while (point := self._points.get()) is not None:
                tracker.log(*point)
            tracker.close()
        except Exception as error:  # a run is worth more than its curves elsewhere
            _log.warning("--track %s is given up, and the run goes on: %s", self._name, error)
