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
from importlib import import_module
from typing import Any, Literal

from common.metrics import Value, Values
from common.process.extras import extra_for
from learner.telemetry.sinks.curves import CurvesSink

TrackerName = Literal["wandb", "mlflow", "trackio"]
PROJECT = "ale-robot"
_STEPS = "agent_steps"
_TAG = "ale_robot.run"
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


Log = Callable[[Mapping[str, float], int], object]
"""Adds a point to each of some curves; agent steps may go back, to those of a test's weights."""
Close = Callable[[], object]


def _wandb(wandb: Any, run: TrackedRun) -> tuple[Log, Close]:
    kept = wandb.init(
        project=PROJECT,
        name=run.name,
        id=run.identity,
        resume="allow",
        config=dict(run.settings),
        settings=wandb.Settings(silent=True),
    )
    # Not its own step, which may not go back.
    kept.define_metric(_STEPS)
    kept.define_metric("*", step_metric=_STEPS)
    return lambda points, agent_steps: kept.log({_STEPS: agent_steps, **points}), kept.finish


def _mlflow(mlflow: Any, run: TrackedRun) -> tuple[Log, Close]:
    mlflow.set_experiment(PROJECT)
    found = mlflow.search_runs(
        filter_string=f"tags.`{_TAG}` = '{run.identity}'", output_format="list"
    )
    if found:
        mlflow.start_run(run_id=found[0].info.run_id)
    else:
        mlflow.start_run(run_name=run.name, tags={_TAG: run.identity})
        mlflow.log_params(dict(run.settings))
    return lambda points, agent_steps: mlflow.log_metrics(points, step=agent_steps), mlflow.end_run


def _trackio(trackio: Any, run: TrackedRun) -> tuple[Log, Close]:
    trackio.init(
        project=PROJECT,
        name=f"{run.name}-{run.identity[:8]}",  # it knows a run by its name alone
        config=dict(run.settings),
        resume="allow",
        auto_log_gpu=False,
    )
    return lambda points, agent_steps: trackio.log(points, step=agent_steps), trackio.finish


TRACKERS: dict[TrackerName, Callable[[Any, TrackedRun], tuple[Log, Close]]] = {
    "wandb": _wandb,
    "mlflow": _mlflow,
    "trackio": _trackio,
}
"""What begins a run with a program, given its module, or goes on with it after a restart; and how
points are added and the run is finished. All of it happens on one thread."""


class TrackerSink(CurvesSink):
    """Gives a run's curves to the tracker called ``name``.

    Raises:
        InputError: it is not installed.
    """

    def __init__(self, name: TrackerName, run: TrackedRun) -> None:
        self._name = name
        self._lost = 0
        with extra_for(f"--track {name}", name):
            program = import_module(name)
        self._points = queue.Queue[tuple[dict[str, float], int] | None](_MOST_WAITING)
        # A daemon: what a hanging server still lacks must not keep the process.
        self._thread = threading.Thread(
            target=self._work, args=(program, run), name=f"track {name}", daemon=True
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

    def _work(self, program: Any, run: TrackedRun) -> None:
        try:
            log, close = TRACKERS[self._name](program, run)
            while (point := self._points.get()) is not None:
                log(*point)
            close()
        except Exception as error:  # a run is worth more than its curves elsewhere
            _log.warning("--track %s is given up, and the run goes on: %s", self._name, error)
