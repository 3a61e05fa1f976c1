"""Merges the figures of all parts into one mapping, and hands it to every sink."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass

from common.metrics import METRICS, Value, Values, number
from common.press_latency import MAX_FRAMES, ms_of, reached_by_age
from common.process.footprint import footprint
from common.protocol.run_status import HealthCheck
from common.run.epochs import EpochRow, EpochTable, epochs_per_day
from common.schedule import Every, Now
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from learner.algorithm.interface import DeviceBatch, Update
from learner.phases import Phases
from learner.telemetry.actor_registry import ActorRegistry
from learner.telemetry.health_checks import judge
from learner.telemetry.held_out import HeldOut
from learner.telemetry.live_feed import LiveFeed
from learner.telemetry.recent_latency import RecentLatency
from learner.telemetry.running_means import RunningMeans
from learner.telemetry.sinks.sink import Sink
from learner.telemetry.snapshot import ActorView, Histogram, Snapshot
from replay.chunk_statistics import ReplayProgress

_RATE_WINDOW = 15.0
"""Seconds over which recent rates are measured."""
_NOTES = 20
_FRAME_EDGES = [ms_of(frames) for frames in range(MAX_FRAMES + 1)]
_OF_2017 = PRESETS["paper"].protocol
"""The protocol of 2017. Its epochs are the unit of ``run/epochs_per_day``, whatever the length of
the run's own epochs."""


@dataclass
class Telemetry(AbstractContextManager["Telemetry"]):
    """Collects what a run shows and records, except for checkpoints and snapshots of weights.

    The end of its block closes all sinks, without figures if `close` has not written them.
    """

    config: RunConfig
    constants: Values
    """Figures that do not change, such as the run's name."""
    phases: Phases
    registry: ActorRegistry
    held_out: HeldOut
    epochs: EpochTable
    """Takes a row for each phase."""
    sinks: Sequence[Sink]
    """Take the figures, each at its own period."""
    feed: LiveFeed
    """Answers the sinks what actors show; closed with them."""
    now: Now
    gpu: Callable[[], Values] = dict
    """Returns memory and utilisation of the GPU, if there is one."""

    def __post_init__(self) -> None:
        for sink in self.sinks:
            sink.watch(self.feed)
        self._started: list[Sink] = []
        """The sinks that are open."""
        self._due = [Every(sink.period, self.now) for sink in self.sinks]
        self._means = RunningMeans()
        self._latency = RecentLatency(self.now)
        self.rows: list[EpochRow] = []
        """The rows of all complete phases and tests."""
        self._ticks: deque[tuple[float, int, int, float]] = deque()
        """Seconds, and the agent steps, updates and processor seconds until then."""
        self._warming_up = False
        self._began_at = 0
        """Agent steps when this process began."""
        self._notes: deque[str] = deque(maxlen=_NOTES)

    def start(self, rows: int = 0, resumed_at: int | None = None) -> None:
        """Opens the files. Drops what a resumed run wrote after its checkpoint.

        Raises InputError if the table of epochs is damaged, or lacks rows.

        Args:
            rows: number of rows that the checkpoint knows of.
            resumed_at: agent steps of the checkpoint; None for a new run.
        """
        self.rows = self.epochs.keep(rows)
        self._began_at = resumed_at or 0
        with ExitStack() as failed:
            failed.callback(self._release)
            for sink in self.sinks:
                sink.start(resumed_at)
                self._started.append(sink)
            failed.pop_all()

    def update(self, batch: DeviceBatch, result: Update) -> None:
        """Takes in one update."""
        self._means.add(batch, result)

    def add(self, row: EpochRow) -> None:
        """Records a complete phase or test."""
        self.epochs.append(row)
        self.rows.append(row)
        agent_steps = row.agent_steps(self.config.replay.learning_starts)
        for sink in self.sinks:
            sink.phase(row, agent_steps)

    def rewards(self, phase: str) -> tuple[float, ...]:
        """Returns the mean scores of the phases of a kind, oldest first; those without a finished
        game are left out."""
        return tuple(
            row.average_reward
            for row in self.rows
            if row.phase == phase and row.average_reward is not None
        )

    def note(self, text: str) -> None:
        """Reports an event, and keeps it among the notes of snapshots."""
        self._notes.append(text)
        for sink in self.sinks:
            sink.event(text)

    def say(self, text: str) -> None:
        """Prints a sentence that stays."""
        for sink in self.sinks:
            sink.line(text)

    def report(self, values: Values, replay: ReplayProgress) -> Sequence[HealthCheck]:
        """Gives the figures to every sink that is due; returns the health checks.

        Args:
            values: figures that only the training loop knows.
        """
        snapshot = self._snapshot(values, replay)
        for sink, schedule in zip(self.sinks, self._due, strict=True):
            if schedule.is_due():
                try:
                    sink.write(snapshot)
                except OSError:
                    schedule.hasten()
                    raise
        return snapshot.checks

    def close(self, values: Values, replay: ReplayProgress) -> None:
        """Writes the last figures and closes all sinks, even if one fails."""
        snapshot = None
        try:
            snapshot = self._snapshot(values, replay)  # fails where the GPU does
        finally:
            self._release(snapshot)

    def __exit__(self, *_: object) -> None:
        self._release()

    def _release(self, last: Snapshot | None = None) -> None:
        """Closes all sinks that are open, even if one fails; each writes ``last`` before."""
        with ExitStack() as end:
            for sink in reversed(self._started):
                end.callback(sink.close)
                if last is not None:
                    end.callback(sink.write, last)
            end.callback(self.feed.close)  # first, so that no sink waits for an actor's picture
            self._started = []

    def _snapshot(self, loop: Values, replay: ReplayProgress) -> Snapshot:
        for text in self.registry.take_notes():
            self.note(text)
        config = self.config
        actors, (totals, key_times) = self.registry.actors(), self.registry.totals()
        of_run: Values = {
            "run/preset": config.preset,
            "run/env": config.env,
            "run/game": config.task,
            "run/seed": config.seed,
            "run/memory_bytes": footprint().private,
            "stream/samples_per_insert_goal": config.samples_per_insert,
            "stream/capacity": config.replay.capacity,
            "stream/actors_alive": sum(actor.alive for actor in actors),
            "stream/actors_present": sum(not actor.left for actor in actors),
        }
        values = _together(
            of_run,
            self.constants,
            replay.values(),
            self.phases.values(),
            self._means.values(),
            self.held_out.values(),
            totals,
            self._latency.values(key_times),
            self._rewards(),
            self._rates(),
            loop,
            self.gpu(),
        )
        if self.phases.train_steps < config.exploration.steps:
            # Until exploration is over, a network cannot be better than a blind one.
            values["learning/relative_td_error"] = None
        values["run/seconds_left"] = self._seconds_left(values, actors)
        values["run/seconds_to_goal"] = self._seconds_to_goal(values, actors)
        checks = judge(values, config)
        values["gates/failed"] = sum(check.passed is False for check in checks)
        if unknown := values.keys() - METRICS.keys():
            raise KeyError(f"declare {sorted(unknown)} in common/metrics.py")
        return Snapshot(
            values=values,
            actors=actors,
            checks=checks,
            notes=tuple(self._notes),
            rewards={phase: self.rewards(phase) for phase in ("random", "train", "test")},
            histograms=self._histograms(key_times),
        )

    def _seconds_left(self, values: Values, actors: Sequence[ActorView]) -> float | None:
        """Returns the time to the end of the phase, or of the last tests; None if it is unknown."""
        if values["run/phase"] == "finishing":
            evaluators = (each.stats for each in actors if each.stats.role == "evaluator")
            # That of whole tests, if there were any: the present one begins at 0.
            rate = number(values, "run/test_steps_per_second")
            rate = rate or sum(stats.steps_per_second for stats in evaluators)
            left = number(values, "evaluation/steps_left")
        else:
            rate = _rate_of_play(values, actors)
            left = self.phases.steps_left
        return left / rate if rate and left is not None else None

    def _seconds_to_goal(self, values: Values, actors: Sequence[ActorView]) -> float | None:
        """Returns the time to the last agent step of the run; None if it, or the rate with
        updates, is unknown, or nobody plays."""
        goal, rate = number(values, "run/steps_goal"), _rate_of_play(values, actors)
        if goal is None or not rate or not self.phases.epoch:
            return None
        return max(goal - self.phases.agent_steps, 0.0) / rate

    def _histograms(self, key_times: tuple[int, ...]) -> dict[str, Histogram]:
        found = {}
        if self.held_out.histogram is not None:
            found["learning/max_q"] = self.held_out.histogram
        for goal in ("press", "release") if key_times else ():
            counts = reached_by_age(key_times, goal)
            found[f"hands/{goal}_ms"] = Histogram(counts, _FRAME_EDGES)
        return found

    def _rates(self) -> dict[str, Value]:
        """Returns recent rates of agent steps, updates and processor time, and steps per second
        over whole phases."""
        phases = self.phases
        now = self.now(), phases.agent_steps, phases.updates, time.process_time()
        if self._warming_up and phases.epoch:
            self._ticks.clear()  # without updates it was several times as fast
        if phases.agent_steps == self._began_at:
            self._ticks.clear()  # its actors are still starting
        self._warming_up = not phases.epoch
        self._ticks.append(now)
        while now[0] - self._ticks[0][0] > _RATE_WINDOW:
            self._ticks.popleft()
        seconds, *done = (new - old for new, old in zip(now, self._ticks[0], strict=True))
        steps_rate, update_rate, busy_cores = (
            each / seconds if seconds >= 1 else None for each in done
        )
        train, test = self._rate("train"), self._rate("test")
        if train is None and phases.epoch:
            train = steps_rate
        return {
            "stream/steps_per_second": steps_rate,
            "learning/updates_per_second": update_rate,
            "run/busy_cores": busy_cores,
            "run/train_steps_per_second": train,
            "run/test_steps_per_second": test,
            "run/epochs_per_day": epochs_per_day(
                _OF_2017.epoch_steps, _OF_2017.test_steps, train, test
            ),
        }

    def _rate(self, phase: str) -> float | None:
        """Returns agent steps per second over the complete phases of a kind."""
        rows = [row for row in self.rows if row.phase == phase]
        seconds = sum(row.epoch_time for row in rows)
        return sum(row.steps for row in rows) / seconds if seconds else None

    def _rewards(self) -> dict[str, Value]:
        tests = [row for row in self.rows if row.phase == "test" and row.average_reward is not None]
        return {
            "play/test_reward": tests[-1].average_reward if tests else None,
            "play/best_test_reward": max(self.rewards("test"), default=None),
            "play/test_epoch": tests[-1].epoch if tests else None,
            "play/random_reward": next(iter(self.rewards("random")), self.phases.random_reward),
        }


def _together(*parts: Values) -> dict[str, Value]:
    """Returns all figures of the parts. Raises KeyError for one that two parts give: which of them
    was meant would depend on their order."""
    found: dict[str, Value] = {}
    for part in parts:
        if twice := found.keys() & part.keys():
            raise KeyError(f"{sorted(twice)} come from two parts of a learner")
        found |= part
    return found


def _rate_of_play(values: Values, actors: Sequence[ActorView]) -> float | None:
    """Returns the recent agent steps per second; None if they are unknown, or nobody plays now."""
    plays = any(actor.alive for actor in actors if actor.stats.role == "actor")
    return number(values, "stream/steps_per_second") if plays else None
