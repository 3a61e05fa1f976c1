"""``--track``: a run's curves, histograms, films and settings for an experiment tracker.

The tracker's own settings decide where it keeps them, and whether anything leaves this machine:
``WANDB_MODE=offline``, ``MLFLOW_TRACKING_URI``, ``TRACKIO_DIR``.

The tracker runs in a thread of its own, so a server that does not answer holds up nothing. If it
fails, it is given up with a warning; if it is too slow, it loses points. The run goes on.
"""

import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from common.metrics import Value, Values
from common.process.extras import PACKAGES, extra_for
from common.registry import Entry, Registry, foreign, placed, resolve
from common.schedule import Every, Now
from learner.telemetry.sinks.curves import FILM, CurvesSink
from learner.telemetry.snapshot import Histogram

PROJECT = "ale-robot"
_STEPS = "agent_steps"
_TAG = "ale_robot.run"
_MAX_WAITING = 256
"""Maximum number of points that wait for a slow tracker: several minutes of a run."""
_FAREWELL = 30.0
"""Seconds that a run waits for the tracker at its end."""
_HISTOGRAM_SECONDS = 300.0
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class TrackedRun:
    """What a tracker gets to know about a run."""

    name: str
    identity: str
    """Unique name of the run, the same after restarts."""
    settings: Mapping[str, Value]
    """Settings by names such as ``learning.n_step``."""


class Tracker(Protocol):
    """A run at an experiment tracker; all calls come from one thread. Whatever it raises ends it
    with a warning, and the run goes on.

    Agent steps may decrease, because a test's figures belong to older weights.
    """

    def add(self, points: Mapping[str, float], agent_steps: int) -> None:
        """Takes a point of each curve."""

    def add_histograms(self, found: Mapping[str, Histogram], agent_steps: int) -> None:
        """Takes histograms, by name."""

    def add_film(self, file: Path, agent_steps: int) -> None:
        """Takes a film of the network that had ``agent_steps``; only with ``--films``."""

    def close(self) -> None:
        """Ends the run there, after all has been added."""


@dataclass(frozen=True)
class TrackerKind(Entry):
    """A tracker: ``factory(run: TrackedRun)`` begins the run there, or continues it after a
    restart, and returns the `Tracker`."""

    extra: str = ""
    """Extra of this project that installs it; another package depends on what it needs."""


class WandB:
    """A run at Weights & Biases."""

    def __init__(self, run: TrackedRun) -> None:
        self._program: Any = import_module("wandb")
        self._run = self._program.init(
            project=PROJECT,
            name=run.name,
            id=run.identity,
            resume="allow",
            config=dict(run.settings),
            settings=self._program.Settings(silent=True),
        )
        # Not W&B's own step, which must not decrease.
        self._run.define_metric(_STEPS)
        self._run.define_metric("*", step_metric=_STEPS)

    def add(self, points: Mapping[str, Any], agent_steps: int) -> None:
        self._run.log({_STEPS: agent_steps, **points})

    def add_histograms(self, found: Mapping[str, Histogram], agent_steps: int) -> None:
        kind = self._program.Histogram
        self.add({name: kind(np_histogram=each) for name, each in found.items()}, agent_steps)

    def add_film(self, file: Path, agent_steps: int) -> None:
        self.add({FILM: self._program.Video(str(file))}, agent_steps)

    def close(self) -> None:
        self._run.finish()


class MLflow:
    """A run in MLflow, which keeps histograms and films as files of the run."""

    def __init__(self, run: TrackedRun) -> None:
        self._program = program = import_module("mlflow")
        program.set_experiment(PROJECT)
        found = program.search_runs(
            filter_string=f"tags.`{_TAG}` = '{run.identity}'", output_format="list"
        )
        if found:
            program.start_run(run_id=found[0].info.run_id)
        else:
            program.start_run(run_name=run.name, tags={_TAG: run.identity})
            program.log_params(dict(run.settings))

    def add(self, points: Mapping[str, float], agent_steps: int) -> None:
        self._program.log_metrics(points, step=agent_steps)

    def add_histograms(self, found: Mapping[str, Histogram], agent_steps: int) -> None:
        for name, each in found.items():
            self._program.log_dict(each._asdict(), f"{name}/{agent_steps:09}.json")

    def add_film(self, file: Path, agent_steps: int) -> None:
        self._program.log_artifact(str(file), FILM)

    def close(self) -> None:
        self._program.end_run()


class Trackio(WandB):
    """A run in Trackio, which has the functions of Weights & Biases."""

    def __init__(self, run: TrackedRun) -> None:
        self._program = self._run = import_module("trackio")
        self._program.init(
            project=PROJECT,
            name=f"{run.name}-{run.identity[:8]}",  # Trackio identifies a run by its name alone
            config=dict(run.settings),
            resume="allow",
            auto_log_gpu=False,
        )

    def add(self, points: Mapping[str, Any], agent_steps: int) -> None:
        self._run.log(points, step=agent_steps)


TRACKERS = Registry(
    "tracker",
    TrackerKind("wandb", WandB, extra="wandb"),
    TrackerKind("mlflow", MLflow, extra="mlflow"),
    TrackerKind("trackio", Trackio, extra="trackio"),
)


class TrackerSink(CurvesSink):
    """Hands a run's figures to the tracker called ``name``.

    Raises:
        InputError: there is no such tracker, or it is not installed.
    """

    def __init__(self, name: str, run: TrackedRun, now: Now = time.monotonic) -> None:
        self._name = name
        self._lost = 0
        self._histograms = Every(_HISTOGRAM_SECONDS, now)
        kind = TRACKERS.find(name)
        factory = f"the factory of the tracker {name!r}"
        with foreign(factory), extra_for(f"--track {name}", kind.extra):
            for package in PACKAGES.get(kind.extra, ()):
                import_module(package)
            begin = resolve(kind.factory)
        self._waiting = queue.Queue[Callable[[Tracker], object] | None](_MAX_WAITING)
        # A daemon thread, so that a hanging server cannot keep the process alive.
        self._thread = threading.Thread(
            target=self._work, args=(begin, run), name=f"track {name}", daemon=True
        )

    def start(self, resumed_at: int | None) -> None:
        """Begins the run at the tracker, or continues it."""
        self._thread.start()

    def add(self, points: Values, agent_steps: int) -> None:
        known = {tag: float(value) for tag, value in points.items() if value is not None}
        self._give(lambda tracker: tracker.add(known, agent_steps))

    def add_histograms(self, found: Mapping[str, Histogram], agent_steps: int) -> None:
        # Seldom, because MLflow keeps each histogram as a file.
        if found and self._histograms.is_due():
            self._give(lambda tracker: tracker.add_histograms(found, agent_steps))

    def filmed(self, file: Path, agent_steps: int) -> None:
        self._give(lambda tracker: tracker.add_film(file, agent_steps))

    def close(self) -> None:
        """Finishes the tracked run, in bounded time."""
        ends = time.monotonic() + _FAREWELL
        with contextlib.suppress(queue.Full):
            self._waiting.put(None, timeout=_FAREWELL)
        self._thread.join(max(ends - time.monotonic(), 0.0))
        if self._thread.is_alive():
            _log.warning("--track %s does not answer: its last points are lost", self._name)
        elif self._lost:
            _log.warning("--track %s lacks %d points of this run", self._name, self._lost)

    def _give(self, what: Callable[[Tracker], object]) -> None:
        if not self._thread.is_alive():
            return
        try:
            self._waiting.put_nowait(what)
        except queue.Full:
            self._lost += 1
            if self._lost == 1:
                _log.warning("--track %s is too slow: it loses points of this run", self._name)

    def _work(self, begin: Callable[[TrackedRun], Tracker], run: TrackedRun) -> None:
        try:
            tracker = begin(run)
            while (give := self._waiting.get()) is not None:
                give(tracker)
            tracker.close()
        except Exception as error:  # a run is worth more than its curves elsewhere
            text = "--track %s is given up, and the run goes on: %s"
            _log.warning(text, self._name, placed(error))
            with contextlib.suppress(queue.Empty):  # or `close` would wait for room in the queue
                while True:
                    self._waiting.get_nowait()
