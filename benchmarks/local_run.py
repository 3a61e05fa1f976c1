"""`LocalRun`: a run of local mode in a temporary folder, watched from outside.

The watched processes do not know that they are measured. Steps, updates and staleness come from
the statistics of chunks, which the replay gives on request; the evaluators' steps come from their
heartbeats, processor time from /proc. A window begins and ends when a chunk is accepted.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import tyro

from benchmarks.child import cpu_seconds, stat_of
from benchmarks.hosted_run import NEVER, HostedRun
from benchmarks.quoted_flags import quoted_flags
from benchmarks.report import BenchmarkOptions
from common.checked import FromOne
from common.command_line.run_options import parse_run
from common.process.cores import usable_cores
from common.protocol.actor_stats import ActorStats
from common.settings.clock import ClockConfig
from common.settings.config import PresetName
from common.transport.interface import Envelope
from learner.options import LearnerOptions, stored_config
from replay.chunk_statistics import ChunkStatistics
from replay.limiter import RateLimiter

ROLES = ("learner", "actors", "evaluator")
Beat = tuple[float, ActorStats]
"""The monotonic seconds at which a heartbeat came, and its content."""
_WARMUP = 256
_SETTLE = 3.0
_LONGEST_SETTLE = 40.0
_POLL = 0.02


@dataclass(frozen=True)
class Setting(BenchmarkOptions):
    """The settings of local mode."""

    env: str = "ale"
    """Environment: the emulator alone, or the robot."""
    game: str = "pong"
    """Game: any that ale-py bundles."""
    preset: PresetName | None = None
    """Preset; by default 'paper' for the emulator alone, 'robot' for the robot."""
    clock: tyro.conf.OmitArgPrefixes[ClockConfig] = field(default_factory=ClockConfig)
    actors: FromOne = 1
    """Number of training actors."""
    evaluators: FromOne = 1
    """Number of evaluators; local mode itself starts one."""
    learner: str = ""
    """More flags for `python -m learner`, as in --learner="--threads 2"."""

    def __str__(self) -> str:
        told = parse_run(LearnerOptions, "learner", self.flags(), stored_config)
        learning = told.config.learning
        return (
            f"{self.game} ({self.env}){self.clock}, batches of {learning.batch_size}, "
            f"an update per {learning.train_period} steps"
        )

    def check(self) -> None:
        super().check()
        self.clock.check(self.env)

    def flags(self) -> list[str]:
        """Returns the flags of `python -m learner`, with the 2017 ratio of samples to steps."""
        return [
            *("--preset", self.preset or ("paper" if self.env == "ale" else "robot")),
            *("--env", self.env, "--game", self.game),
            *("--actors", str(self.actors), "--evaluators", str(self.evaluators)),
            *self.clock.flags(),
            *("--replay.capacity", "100000", "--replay.learning-starts", str(_WARMUP)),
            # After the warm-up ε has its final value, so that the network chooses.
            *("--exploration.steps", "1", "--protocol.held-out-states", str(_WARMUP)),
            *quoted_flags(self.learner, "--learner"),
        ]


class Mark(NamedTuple):
    """The run at one moment."""

    at: float
    newest: ChunkStatistics
    """Statistics with the chunk that was just accepted."""
    cpu: dict[int, tuple[str, float]]
    """Role and seconds of processor time, by process."""

    @property
    def begun(self) -> int:
        """Number of updates that had begun when the chunk came."""
        return self.newest.weights_version + self.newest.staleness


class Pace(NamedTuple):
    """The figures of one window; rates are per second of wall clock."""

    seconds: float
    train_steps_per_second: float
    updates_per_second: float
    test_steps_per_second: float
    samples_per_insert: float
    staleness_p50: float
    """Updates by which an actor's weights were behind when its chunk arrived."""
    staleness_p95: float
    deadlines_kept: float | None
    """Share of the actors' agent steps that were in time, and so was their command; None with
    ``sync``."""
    cpu_share: dict[str, float]
    """Share of the time of all usable cores, by role."""


class LocalRun(HostedRun):
    """`python -m learner --local`; a context manager that ends it.

    Args:
        epoch_steps: training steps after which the first test begins.
        steps: steps after which training ends; only a test that has begun goes on.
    """

    def __init__(
        self,
        setting: Setting,
        *,
        epoch_steps: int = NEVER,
        steps: int = NEVER,
    ) -> None:
        super().__init__(
            "learner",
            *("--local", "--protocol.epoch-steps", str(epoch_steps), "--steps", str(steps)),
            *("--protocol.test-steps", str(NEVER)),
            *setting.flags(),
        )
        self._setting = setting
        self._heard: list[Beat] = []  # a thread of Zenoh's appends to it
        self._chunks: list[ChunkStatistics] = []

    def _watch(self, stack: ExitStack) -> None:
        self._limiter = RateLimiter.of(self.config)
        self.transport.subscribe(self.keys.stats("*", "*"), self._hear)

    def _hear(self, message: Envelope) -> None:
        stats = ActorStats.decode(message.payload)
        self._heard.append((time.monotonic(), stats))

    # ------------------------------------------------------------------ waiting

    def settle(self) -> None:
        """Waits until the run is in a steady state, in which one side waits for the other; 40 s at
        most."""
        began = None
        ratio, steps = self._limiter.samples_per_insert, self.config.stream.chunk_steps
        most = self._limiter.tolerance * ratio
        while True:
            mark = self._mark()
            if not mark.begun:
                continue
            began = mark.at if began is None else began
            drawn = mark.begun * self._limiter.batch_size
            deficit = self._limiter.deficit(mark.newest.agent_steps, drawn)
            # A learner that waits is seen just after a chunk came: hence the allowance of two.
            settled = deficit >= most or deficit <= 2 * steps * ratio - most
            waited = mark.at - began
            if waited >= _LONGEST_SETTLE or (waited >= _SETTLE and settled):
                return

    def await_tests(self) -> None:
        """Waits until all evaluators play."""
        self._await(
            lambda stats: stats.role == "evaluator" and stats.steps > 0, self._setting.evaluators
        )

    def await_rest(self) -> None:
        """Waits until training is over and all actors have left."""
        self._await(lambda stats: stats.role == "actor" and stats.leaving, self._setting.actors)

    def _await(self, holds: Callable[[ActorStats], bool], count: int) -> None:
        """Waits until a condition holds for ``count`` processes."""
        while True:
            found = {stats.name for _, stats in tuple(self._heard) if holds(stats)}
            if len(found) == count:
                return
            self.check()
            time.sleep(_POLL)

    def _mark(self) -> Mark:
        """Waits until the next chunk is accepted; returns the run at that moment."""
        now, chunks = self.next_chunks()
        self._chunks += chunks
        return Mark(now, chunks[-1], _cpu_times(self.process.pid))

    # ------------------------------------------------------------------ measuring

    def test_rate(self, seconds: float) -> float:
        """Returns the test steps per second of all evaluators together, over ``seconds``."""
        began = time.monotonic()
        time.sleep(seconds)
        self.check()
        return rate_of_tests(self._heard_between(began, time.monotonic()))

    def _heard_between(self, begin: float, end: float) -> list[Beat]:
        return [(at, stats) for at, stats in tuple(self._heard) if begin <= at <= end]

    def measure(self, seconds: float) -> Pace:
        """Measures for ``seconds``, and until the next chunk."""
        self._mark()  # takes the chunks that came before
        begin = self._mark()
        self._chunks.clear()
        time.sleep(seconds)
        self._mark()
        end = self._mark()
        wall = end.at - begin.at
        steps = end.newest.agent_steps - begin.newest.agent_steps
        updates = end.begun - begin.begun
        staleness = [chunk.staleness for chunk in self._chunks]
        heard = self._heard_between(begin.at, end.at)
        return Pace(
            seconds=wall,
            train_steps_per_second=steps / wall,
            updates_per_second=updates / wall,
            test_steps_per_second=rate_of_tests(heard),
            samples_per_insert=updates * self.config.learning.batch_size / steps,
            staleness_p50=float(np.percentile(staleness, 50)),
            staleness_p95=float(np.percentile(staleness, 95)),
            deadlines_kept=None if self._setting.clock.sync else deadlines_kept(heard),
            cpu_share=cpu_share(begin.cpu, end.cpu, wall),
        )


def first_and_last(heard: Sequence[Beat], role: str) -> list[tuple[Beat, Beat]]:
    """Returns the first and the last heartbeat of each process in ``role``."""
    found: dict[int, tuple[Beat, Beat]] = {}
    for beat in heard:
        if beat[1].role == role:
            first, _ = found.get(beat[1].incarnation, (beat, beat))
            found[beat[1].incarnation] = first, beat
    return list(found.values())


def rate_of_tests(heard: Sequence[Beat]) -> float:
    """Returns the steps per second of all evaluators, each between its first and last heartbeat."""
    return sum(
        (last.steps - first.steps) / (until - since)
        for (since, first), (until, last) in first_and_last(heard, "evaluator")
        if until > since
    )


def deadlines_kept(heard: Sequence[Beat]) -> float | None:
    """Returns the share of the actors' agent steps whose command came in time; None without any."""
    agent_steps = missed = 0
    for (_, first), (_, last) in first_and_last(heard, "actor"):
        agent_steps += last.decisions - first.decisions
        missed += last.missed_deadlines - first.missed_deadlines
    return 1 - missed / agent_steps if agent_steps else None


def cpu_share(
    before: dict[int, tuple[str, float]], after: dict[int, tuple[str, float]], wall: float
) -> dict[str, float]:
    """Returns the processor time by role between two marks, as a share of all cores' time."""
    spent = dict.fromkeys(ROLES, 0.0)
    for process, (role, seconds) in after.items():
        spent[role] += seconds - before.get(process, (role, 0.0))[1]
    cores = usable_cores()
    return {role: seconds / (wall * cores) for role, seconds in spent.items()}


def _cpu_times(learner: int) -> dict[int, tuple[str, float]]:
    """Returns role and processor seconds of the learner and its children; Linux only."""
    found: dict[int, tuple[str, float]] = {}
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            process = int(entry.name)
            stat = stat_of(process)
            if learner not in (process, int(stat[1])):
                continue
            command = (entry / "cmdline").read_bytes().split(b"\0")
        except OSError:  # the process has ended
            continue
        role = "learner"
        if process != learner:
            role = "evaluator" if b"--evaluator" in command else "actors"
        found[process] = (role, cpu_seconds(stat))
    return found
