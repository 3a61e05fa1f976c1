"""The training loop's promises, with fakes: no process, no network, no time but the test's."""

import errno
import math
import os
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import groupby
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load

from common.checked import MAX_COUNT
from common.errors import InputError
from common.metrics import Values
from common.protocol.actor_stats import ActorStats
from common.protocol.chunk import Game
from common.protocol.run_keys import DEMONSTRATIONS
from common.protocol.run_status import HealthCheck
from common.protocol.weights import are_finite
from common.protocol.wire import decode_version
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from learner.algorithm.interface import Update
from learner.broadcast import Broadcast
from learner.health_guard import HealthGuard
from learner.loss_guard import LossGuard
from learner.phases import Phases
from learner.run_clock import RunClock
from learner.telemetry.snapshot import ActorView
from learner.training import Learner
from replay.chunk_statistics import ChunkStatistics, ReplayProgress

CONFIG = replace(
    PRESETS["fast"],
    replay=replace(PRESETS["fast"].replay, learning_starts=100, sampler="uniform"),
    protocol=replace(PRESETS["fast"].protocol, epoch_steps=200, test_steps=50),
    learning=replace(
        PRESETS["fast"].learning,
        train_period=4,
        publish_period=10,
        checkpoint_period=25,
    ),
)
RED = HealthCheck(name="valid frames", value=0.0, passed=False, bound="≥ 0.99", why="it is blind")


class Stop(threading.Event):
    """A stop event on the test's clock: waiting turns it."""

    def __init__(self, world: "World") -> None:
        super().__init__()
        self._world = world

    def wait(self, timeout: float | None = None) -> bool:
        self._world.passes(timeout or 0.0)
        return self.is_set()


@dataclass
class World:
    """Everything around a learner: actors that play, a disk, evaluators, who looks, and the time.

    An update takes `update_seconds`; before each, the actors send a chunk of `chunk_steps`.
    """

    config: RunConfig = CONFIG
    update_seconds: float = 0.01
    chunk_steps: int = 4
    last_update: int = 10**9
    """No minibatch comes after so many updates."""
    now: float = 1_000.0
    chunks: list[ChunkStatistics] = field(default_factory=list)
    portion: int = 10**9
    """Chunks that the replay tells at a time."""
    lost: int = 0
    """Steps that the replay has lost."""
    failed: str = ""
    """What the replay's sampler did wrong."""
    goals: set[int | None] = field(default_factory=set)
    """What the replay was told of the run's end."""
    loss: Callable[[int], float] = lambda _: 0.5
    log_syncs: bool = False
    spoils: bool = True
    """Whether a loss that is not finite spoils the network's weights."""
    spoilt_at: int = 0
    """The update that spoils them although its loss is finite."""
    updates: int = 0
    published: list[tuple[float, int, bytes]] = field(default_factory=list)
    """When, which version, and the payload."""
    checkpoints: list[dict[str, Any]] = field(default_factory=list)
    evaluators: set[str] = field(default_factory=lambda: {"e"})
    actors: set[str] = field(default_factory=set)
    scores: list[float] = field(default_factory=lambda: [1.0])
    """Score of each test in turn; the last for all others."""
    test_seconds: float = 0.0
    """How long each test takes."""
    checks: tuple[HealthCheck, ...] = ()
    samplable: int | None = None
    """Steps that can be drawn; all, if it is None."""
    said: list[str] = field(default_factory=list)
    log: list[Any] = field(default_factory=list)
    """What happened, in order."""
    at: list[tuple[Callable[[], bool], Callable[[], None]]] = field(default_factory=list)
    """What shall happen once a condition holds."""

    def __post_init__(self) -> None:
        self.stop = Stop(self)
        self.agent_steps = sum(each.steps for each in self.chunks)
        self.rows: list[Any] = []
        self.network = torch.nn.Linear(1, 1, bias=False)
        self.credited: list[int] = []
        """Chunks by which the registry knows its actors."""
        self.pending: list[Any] = []
        self.priorities: list[Any] = []
        self.free = True
        self.full = False
        """Whether there is no room even for a checkpoint."""
        self.first = 0
        """Chunk from which a resumed learner counts."""
        self.ended: dict[str, bool] = {}
        """Whether each process that has gone said farewell."""
        self.told: list[Values] = []
        """The loop's figures at each look."""

    def passes(self, seconds: float) -> None:
        self.now += seconds
        for each in [each for each in self.at if each[0]()]:
            self.at.remove(each)
            each[1]()

    def once(self, condition: Callable[[], bool], action: Callable[[], None]) -> None:
        self.at.append((condition, action))

    def play(self, steps: int, actor: str = "a") -> None:
        """An actor sends a chunk in which a game ended, whose score is the chunk's number."""
        index = len(self.chunks)
        self.agent_steps += steps
        self.chunks.append(
            ChunkStatistics(
                *(index, self.agent_steps, steps, actor, 1.0, 0, 0, steps, steps),
                games=(Game(float(index), 10),),
            )
        )

    # ---------------------------------------------------------------- minibatches and replay

    def draw(self, updates: int) -> "World":
        self.log.append(("draw from", updates))
        return self

    def next(self, timeout: float) -> Any:
        if self.updates >= self.last_update:
            self.passes(timeout)
            return None
        self.passes(self.update_seconds)
        if self.stop.is_set():
            return None
        if self.chunk_steps:
            self.play(self.chunk_steps)
        return SimpleNamespace(ids=np.arange(2), prepared=SimpleNamespace(batch=None))

    def close(self) -> None:
        self.log.append("minibatches end")

    def replay_progress(self, since: int, *, goal: int | None = None) -> ReplayProgress:
        self.goals.add(goal)
        known = self.agent_steps - self.lost
        # One that is counted already is told again: each counts once all the same.
        begin = max(since - 1, 0)
        told = tuple(self.chunks[begin : begin + self.portion])
        samplable = known if self.samplable is None else self.samplable
        throttle = self.updates >= self.last_update
        return ReplayProgress(
            *(known, known, samplable, len(self.chunks), 0, 0, throttle, 0, 0, 0, told),
            failed=self.failed,
        )

    # ---------------------------------------------------------------- algorithm

    def priorities_of(self, loss: float) -> list[float]:
        """Where the loss is NaN, the second of the two steps is at fault."""
        return [2.0, loss if math.isnan(loss) else 1.0]

    def update(self, prepared: Any) -> Any:
        self.updates += 1
        loss = self.loss(self.updates)
        spoilt = (self.spoils and not math.isfinite(loss)) or self.updates == self.spoilt_at
        weight = float("nan") if spoilt else self.updates
        with torch.no_grad():
            self.network.weight.fill_(weight)
        return Update(
            torch.tensor(loss), torch.tensor(self.priorities_of(loss)), *torch.zeros(2, 2)
        )

    # ---------------------------------------------------------------- evaluation

    def add(self, test: Any, weights: bytes, record: Callable[[], object]) -> None:
        record()
        self.log.append(("test", test.epoch, weights))
        self.pending.append(test)
        self.added = self.now

    def take_finished(self) -> Any:
        if not self.pending or not self.evaluators or self.now < self.added + self.test_seconds:
            return None
        test = self.pending.pop(0)
        score = self.scores.pop(0) if len(self.scores) > 1 else self.scores[0]
        return replace(test, steps=50, scores=[score], began=0.0)

    def restore_tests(self, state: Any) -> list[int]:
        self.log.append(("tests", state))
        return [9]

    # ---------------------------------------------------------------- the learner

    def report(self, values: Values, replay: ReplayProgress) -> tuple[HealthCheck, ...]:
        self.told.append(values)
        return self.checks

    def summarise(self, values: Values, replay: ReplayProgress) -> None:
        self.summed_steps = replay.agent_steps
        self.log.append(("summary", self.phases.updates))

    def broadcast(self, payload: bytes, version: bytes) -> None:
        number, signature = decode_version(version, "id")
        assert signature == repr(("training", number, "id")).encode()
        self.published.append((self.now, number, payload))

    def save(self, state: dict[str, Any]) -> None:
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.checkpoints.append(state)
        assert self.credited == [*range(self.first, state["books"]["facts_seen"])]
        assert not self.log_syncs or self.log[-1] == "sync"
        self.log.append(("checkpoint", state["updates"]))

    def check_room(self) -> None:
        if not self.free:
            raise OSError(errno.ENOSPC, "No space left on device", "FOLDER")

    def learner(
        self, steps_goal: int | None = None, *, force: bool = False, stall_minutes: float = 10.0
    ) -> Learner:
        clock = RunClock(lambda: self.now)
        self.phases = Phases(self.config, clock)
        parts: dict[str, Any] = {
            "replay": SimpleNamespace(
                run_id="id",
                sync=lambda: self.log.append("sync") if self.log_syncs else None,
                drain=lambda: self.log.append("drain"),
                progress=self.replay_progress,
                update_priorities=lambda *told: self.priorities.append(told),
            ),
            "algorithm": SimpleNamespace(
                update=self.update,
                published=self.network,
                is_finite=lambda: are_finite(list(self.network.parameters())),
                continue_from=lambda updates: self.log.append(("continue_from", updates)),
            ),
            "held_out": SimpleNamespace(
                draw=lambda: self.log.append("held out"),
                measure=lambda: self.log.append(("measure", self.now)),
                mean=2.5,
            ),
            "evaluation": _Evaluation(
                world=self,
                snapshots=SimpleNamespace(keep=False),
                add=self.add,
                take_finished=self.take_finished,
                state=lambda: [test.epoch for test in self.pending],
                restore=self.restore_tests,
                forget=lambda test: self.log.append(("forget", test.epoch)),
                settle=lambda test, best: self.log.append(("settle", test.epoch, best)),
                sweep=lambda: self.log.append("sweep"),
                finish=lambda: self.log.append("evaluators may leave"),
                steps_left=0,
                reports=0,
                join="ale-robot join --connect tcp/h:1",
            ),
            "registry": SimpleNamespace(
                alive=lambda role: self.actors if role == "actor" else self.evaluators,
                actors=lambda: [
                    ActorView(
                        stats=ActorStats(name, "actor", leaving=self.ended.get(name, False)),
                        alive=name not in self.ended,
                    )
                    for name in self.actors | self.evaluators
                ],
                state=lambda: ["a"],
                restore=lambda state: self.log.append(("actors", state)),
                accepted=lambda chunk: self.credited.append(chunk.index),
            ),
            "telemetry": SimpleNamespace(
                rows=self.rows,
                add=self.rows.append,
                rewards=lambda phase: [r.average_reward for r in self.rows if r.phase == phase],
                update=lambda batch, result: None,
                note=self.said.append,
                say=self.said.append,
                report=self.report,
                close=self.summarise,
            ),
            "checkpoint": SimpleNamespace(path="FILE", save=self.save, check_room=self.check_room),
        }
        algorithm = parts["algorithm"]
        parts["losses"] = LossGuard(algorithm, parts["replay"], Path("FILE"), self.said.append)
        self.phases.steps_goal = steps_goal
        return Learner(
            config=self.config,
            draw=self.draw,  # type: ignore[arg-type]
            broadcast=Broadcast(
                *(algorithm, "id", self.broadcast),
                sign=lambda *told: repr(told[:3]).encode(),
                now=clock.now,
            ),
            phases=self.phases,
            guard=HealthGuard(
                *(5.0, stall_minutes, 4), force=force, warn=self.said.append, now=lambda: self.now
            ),
            clock=clock,
            stop=self.stop,
            **parts,
        )

    def stops_at(self, updates: int) -> None:
        self.once(lambda: self.updates >= updates, self.stop.set)


class _Evaluation(SimpleNamespace):
    world: World

    @property
    def pending(self) -> int:
        return len(self.world.pending)


def run(world: World, **more: Any) -> Learner:
    """A learner's whole life."""
    learner = world.learner(**more)
    learner.start()
    learner.run()
    return learner


def weight_of(updates: int) -> torch.Tensor:
    return torch.full((1, 1), float(updates))


def test_a_new_learner_does_nothing_before_it_starts() -> None:
    world = World()
    learner = world.learner()
    assert (world.log, world.published, world.checkpoints) == ([], [], [])
    learner.start()
    assert [version for _, version, _ in world.published] == [0]
    assert world.log == [("checkpoint", 0)]  # no thread yet, which nobody would end


def test_weights_are_published_every_few_updates_with_their_version() -> None:
    world = World()
    world.stops_at(35)
    run(world)
    assert [version for _, version, _ in world.published] == [0, 10, 20, 30]
    for _, version, payload in world.published[1:]:
        assert torch.equal(load(payload)["weight"], weight_of(version))


def test_weights_are_published_again_every_ten_seconds() -> None:
    world = World(last_update=5, chunk_steps=0)
    world.once(lambda: world.now >= 1_045.0, world.stop.set)
    run(world, stall_minutes=1e9)
    times = [at for at, _, _ in world.published]
    assert [version for _, version, _ in world.published] == [0, 5, 5, 5, 5]
    assert np.diff(times) == pytest.approx([10.0] * 4, abs=0.5)


def test_what_updates_publish_is_not_published_again() -> None:
    world = World(update_seconds=0.9)  # 9 s for ten updates
    world.stops_at(60)
    run(world)
    assert [version for _, version, _ in world.published] == [0, 10, 20, 30, 40, 50, 60]


def test_checkpoints_come_by_updates_at_each_epochs_end_and_at_the_stop() -> None:
    # 4 steps an update: the warm-up ends about update 25, epoch 1 about update 75.
    world = World(update_seconds=1.0, evaluators=set())
    world.stops_at(82)
    run(world)
    made = [state["updates"] for state in world.checkpoints]
    assert made == [0, 25, 25, 50, 75, 75, 82]
    assert [row.weight_updates for row in world.rows] == [25, 75]


def test_the_replay_is_on_the_disk_before_a_checkpoint_that_knows_of_it() -> None:
    world = World(log_syncs=True)
    world.stops_at(60)
    run(world)
    assert len(world.checkpoints) > 2


def test_a_resumed_run_has_all_its_counters() -> None:
    first = World(evaluators=set(), scores=[1.0])
    first.stops_at(90)
    run(first)
    last = first.checkpoints[-1]
    assert (last["updates"], last["rows"], last["tests"], last["actors"]) == (90, 2, [1], ["a"])
    assert last["phase_updates"] < 90
    assert last["phase_loss"] == pytest.approx(0.5 * last["phase_updates"])

    second = World(chunks=first.chunks)
    second.rows = first.rows
    second.first = last["books"]["facts_seen"]
    learner = second.learner()
    learner.restore(last)
    second.now += 7.0
    learner.start()
    again = second.checkpoints[0]
    assert again.pop("seconds") == pytest.approx(last["seconds"] + 7.0)
    assert again == {**{k: v for k, v in last.items() if k != "seconds"}, "tests": []}
    assert second.published[0][1] == 90
    assert ("continue_from", 90) in second.log
    assert ("tests", [1]) in second.log
    assert second.said == ["Epoch 9 stays untested: its snapshot is missing."]
    assert ("actors", ["a"]) in second.log
    second.stop.set()
    learner.run()
    assert ("draw from", 90) in second.log


@pytest.mark.parametrize("portion", [2, 3, 7])
def test_all_that_was_played_meanwhile_is_counted_before_the_first_update(portion: int) -> None:
    world = World(portion=portion, chunk_steps=0)
    for _ in range(6):
        world.play(4)
    seen: list[int] = []
    world.once(lambda: world.updates == 1, lambda: seen.extend(world.credited))
    world.stops_at(2)
    run(world)
    assert seen == list(range(6))


def test_the_end_of_a_phase_gives_its_row_and_an_epochs_snapshot_to_evaluation() -> None:
    world = World(update_seconds=1.0, evaluators=set())
    world.stops_at(76)
    run(world)
    warm_up, epoch = world.rows
    assert (warm_up.epoch, warm_up.phase, warm_up.steps, warm_up.nr_games) == (0, "random", 100, 25)
    assert (epoch.epoch, epoch.phase, epoch.steps, epoch.nr_games) == (1, "train", 200, 50)
    assert epoch.average_reward == np.mean(range(25, 75))
    assert (epoch.total_train_steps, epoch.replay_memory_count, epoch.meanq) == (200, 300, 2.5)
    assert epoch.meancost == 0.5
    assert (warm_up.epoch_time, epoch.epoch_time, epoch.total_time) == (25.0, 50.0, 75.0)
    assert epoch.last_exploration_rate == CONFIG.epsilon_at(300)
    assert world.log.count("held out") == 2  # tried again, in case the first replay was blind
    ((_, tested, weights),) = [each for each in world.log if each[0] == "test"]
    assert tested == 1
    assert torch.equal(load(weights)["weight"], weight_of(75))
    # First the checkpoint that knows of the test, then snapshots it does not need go.
    at = world.log.index(("test", 1, weights))
    assert world.log[at + 1 : at + 3] == [("checkpoint", 75), "sweep"]


def test_tests_are_recorded_and_settled_against_the_best_before() -> None:
    world = World(update_seconds=1.0, scores=[-3.0, 7.0, 5.0, 6.0])
    run(world, steps_goal=100 + 3 * 200)
    tests = [row for row in world.rows if row.phase == "test"]
    assert [(row.epoch, row.average_reward, row.steps) for row in tests] == [
        (1, -3.0, 50),
        (2, 7.0, 50),
        (3, 5.0, 50),
    ]
    settled = [each for each in world.log if each[0] == "settle"]
    assert settled == [("settle", 1, None), ("settle", 2, -3.0), ("settle", 3, 7.0)]
    for each in settled:  # the best is kept, then forgotten by a checkpoint, then snapshots go
        at = world.log.index(each)
        assert world.log[at + 1] == ("forget", each[1])
        assert (world.log[at + 2][0], world.log[at + 3]) == ("checkpoint", "sweep")


def test_a_full_disk_pauses_training_and_nothing_is_lost() -> None:
    world = World()
    world.free = False
    world.once(lambda: world.now >= 1_060.0, lambda: setattr(world, "free", True))
    world.stops_at(50)
    run(world)
    assert world.updates == 50
    assert world.published[1][0] >= 1_060.0


def test_a_stop_while_training_waits_for_room_ends_it_with_a_last_checkpoint() -> None:
    world = World()
    world.free = False
    world.once(lambda: world.now >= 1_060.0, world.stop.set)
    run(world)
    assert [state["updates"] for state in world.checkpoints] == [0, world.updates]
    assert world.log[-1] == ("summary", world.updates)
    assert world.said == [
        "WARNING: FOLDER cannot be written (No space left on device): training waits until it can.",
        "stopping: writing a checkpoint ...",
    ]


@pytest.mark.parametrize(
    ("part", "write"),
    [
        ("checkpoint", "save"),
        ("telemetry", "report"),
        ("telemetry", "add"),
        ("held_out", "draw"),
        ("evaluation", "add"),
        ("evaluation", "settle"),
        ("evaluation", "sweep"),
    ],
)
def test_a_disk_that_fills_under_a_write_is_waited_for(part: str, write: str) -> None:
    world = World(update_seconds=1.0, scores=[-3.0, 7.0, 5.0, 6.0])
    learner = world.learner(steps_goal=100 + 3 * 200)
    learner.start()
    owner = getattr(learner, part)
    real = getattr(owner, write)
    refused: list[Any] = []

    def refuse_once(*given: Any) -> Any:
        if not refused:
            refused.append(given)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "FILE")
        return real(*given)

    setattr(owner, write, refuse_once)
    learner.run()
    assert len(refused) == 1
    tests = [row.average_reward for row in world.rows if row.phase == "test"]
    assert tests == [-3.0, 7.0, 5.0]
    assert "WARNING: FILE cannot be written (No space left on device)" in " ".join(world.said)
    assert world.said.count("The disk can be written again: training continues.") == 1


@pytest.mark.parametrize("phase", ["random", "train", "test"])
def test_a_row_that_cannot_be_written_is_made_by_the_resumed_run(phase: str) -> None:
    first = World(update_seconds=1.0)
    learner = first.learner()
    learner.start()

    def add(row: Any) -> None:
        if row.phase == phase:
            raise OSError(errno.EIO, "Input/output error")
        first.rows.append(row)

    learner.telemetry.add = add  # type: ignore[method-assign]
    with pytest.raises(OSError, match="Input/output"):
        learner.run()
    last = first.checkpoints[-1]
    assert last["updates"] == first.updates
    assert last["rows"] == len(first.rows)
    assert ("forget", 1) not in first.log
    if phase == "test":
        return  # the coordinator's own tests say that it is in the checkpoint

    second = World(update_seconds=1.0, chunks=first.chunks)
    second.rows += first.rows
    second.first = last["books"]["facts_seen"]
    learner = second.learner()
    learner.restore(last)
    learner.start()
    second.stops_at(10)
    learner.run()
    made = [(row.epoch, row.steps) for row in second.rows if row.phase != "test"]
    assert made == ([(0, 104)] if phase == "random" else [(0, 100), (1, 204)])  # one chunk more


@pytest.mark.parametrize("sampler", ["uniform", "prioritised"])
def test_a_loss_that_diverges_ends_the_run_and_keeps_what_was_good(sampler: Any) -> None:
    config = replace(CONFIG, replay=replace(CONFIG.replay, sampler=sampler))
    world = World(config, loss=lambda update: 0.5 if update < 33 else float("nan"))
    world.update_seconds = 1.0
    learner = world.learner()
    learner.start()
    with pytest.raises(InputError, match=r"became non-finite at update 33: .*--initial FILE\.$"):
        learner.run()
    assert world.checkpoints[-1]["updates"] == 25
    assert len(world.priorities) == (32 if sampler == "prioritised" else 0)
    assert world.log[-1][0] == "summary"


def test_a_sampler_that_fails_ends_the_run_with_its_sentence_and_everything_kept() -> None:
    told = "the sampler 'newest' fails: mend its package."
    world = World()
    world.once(lambda: world.agent_steps >= 200, lambda: setattr(world, "failed", told))
    world.stops_at(400)
    learner = world.learner()
    learner.start()
    with pytest.raises(InputError) as error:
        learner.run()
    assert str(error.value) == told
    assert world.said == [f"The run ends: {told}"]  # before its children have ended
    assert world.checkpoints[-1]["updates"] == world.updates
    assert world.log[-1][0] == "summary"


def test_nothing_of_a_network_that_diverged_between_two_looks_is_published_or_kept() -> None:
    for first in (10, 25):
        world = World(loss=lambda update, first=first: 0.5 if update < first else float("nan"))  # type: ignore[misc]
        world.update_seconds = 0.0
        learner = world.learner()
        learner.start()
        with pytest.raises(InputError, match=f"non-finite at update {first}:"):
            learner.run()
        assert max(version for _, version, _ in world.published) < first
        assert max(state["updates"] for state in world.checkpoints) < first


@pytest.mark.parametrize("spoilt", [10, 25, 50])
def test_weights_that_became_non_finite_by_a_finite_loss_are_neither_published_nor_kept(
    spoilt: int,
) -> None:
    """As of an optimizer that divided by zero, just when they are due."""
    world = World(spoilt_at=spoilt)
    world.stops_at(60)
    learner = world.learner()
    learner.start()
    with pytest.raises(InputError, match=rf"^weights became non-finite by update {spoilt}: .*FILE"):
        learner.run()
    assert max(state["updates"] for state in world.checkpoints) < spoilt
    assert max(version for _, version, _ in world.published) < spoilt


@pytest.mark.parametrize("sampler", ["uniform", "prioritised"])
@pytest.mark.parametrize(("loss", "faulty"), [(math.nan, [1]), (math.inf, [0, 1])])
def test_a_minibatch_that_is_not_finite_is_quarantined_and_the_run_goes_on(
    sampler: Any, loss: float, faulty: list[int]
) -> None:
    config = replace(CONFIG, replay=replace(CONFIG.replay, sampler=sampler))
    world = World(config, loss=lambda update: loss if update % 12 == 0 else 0.5, spoils=False)
    world.stops_at(60)
    run(world)
    assert world.updates == 60
    told = [ids.tolist() for ids, priorities in world.priorities if np.isnan(priorities).all()]
    assert told == [faulty] * 5
    learned = [ids for ids, priorities in world.priorities if np.isfinite(priorities).all()]
    assert len(learned) == (60 - len(told) if sampler == "prioritised" else 0)
    assert world.said[0].startswith(
        f"a minibatch was skipped: its loss is not finite; {len(faulty)} of its steps"
    )
    assert max(version for _, version, _ in world.published) == 60
    assert math.isfinite(world.checkpoints[-1]["phase_loss"])


@pytest.mark.parametrize(("every", "last"), [(1, 42), (10, 123)])
def test_ten_recent_minibatches_that_are_not_finite_are_the_networks_fault(
    every: int, last: int
) -> None:
    def loss(update: int) -> float:
        return math.nan if update >= 33 and (update - 33) % every == 0 else 0.5

    world = World(loss=loss, spoils=False)
    world.update_seconds = 1.0
    learner = world.learner()
    learner.start()
    with pytest.raises(InputError, match="became non-finite at update 33: "):
        learner.run()
    assert world.updates == last


def test_more_than_ten_of_them_are_not_where_they_are_rare() -> None:
    world = World(loss=lambda update: math.nan if update % 12 == 0 else 0.5, spoils=False)
    world.stops_at(200)
    run(world)
    assert world.updates == 200


def test_priorities_go_back_to_a_prioritised_replay() -> None:
    world = World(replace(CONFIG, replay=replace(CONFIG.replay, sampler="prioritised")))
    world.stops_at(3)
    run(world)
    ids, priorities = world.priorities[0]
    assert (ids.tolist(), priorities.tolist()) == ([0, 1], [2.0, 1.0])


def test_an_algorithm_that_gives_negative_priorities_is_named() -> None:
    world = World(replace(CONFIG, replay=replace(CONFIG.replay, sampler="prioritised")))
    world.priorities_of = lambda loss: [2.0, -1.0]  # type: ignore[method-assign]
    with pytest.raises(InputError, match="'qr_dqn' gives negative priorities: return magni"):
        run(world)
    assert not world.priorities


def test_a_gate_that_stays_red_ends_the_run() -> None:
    world = World(update_seconds=0.25, checks=(RED,))
    learner = run(world)
    assert learner.failed is not None
    assert re.match(
        r"health check 'valid frames' has been red for 5 minutes and 640 steps", learner.failed
    )
    # Judged from the end of the warm-up on, which the first 25 updates are.
    assert world.now == pytest.approx(1_000 + 25 * 0.25 + 300, abs=2.0)
    assert world.checkpoints[-1]["updates"] == world.updates


def test_force_only_warns_of_a_red_gate_once() -> None:
    world = World(update_seconds=0.25, checks=(RED,))
    world.once(lambda: world.now >= 1_700.0, world.stop.set)
    learner = run(world, force=True)
    assert learner.failed is None
    warning, stopping = world.said
    assert warning.startswith("WARNING: health check 'valid frames' has been red")
    assert stopping == "stopping: writing a checkpoint ..."


def test_a_run_in_which_nothing_happens_ends() -> None:
    world = World(last_update=50)
    learner = run(world)
    assert world.now == pytest.approx(1_000 + 50 * world.update_seconds + 600, abs=2.0)
    assert learner.failed is not None
    told = "no agent step came and no update was made for 10 minutes: the logs of actors and"
    assert told in learner.failed


def test_a_replay_of_which_nothing_can_be_drawn_is_told_as_the_reason() -> None:
    """A throttled one of which something can be drawn only waits for updates, as here above."""
    world = World(last_update=50)
    world.once(lambda: world.updates >= 50, lambda: setattr(world, "samplable", 0))
    learner = run(world)
    assert learner.failed is not None
    assert "none of the replay's 200 steps can be drawn" in learner.failed
    assert "a smaller --learning.n-step" in learner.failed


def test_actors_that_are_still_to_come_are_waited_for() -> None:
    world = World(last_update=0)
    world.once(lambda: world.now >= 3_000.0, world.stop.set)
    assert run(world).failed is None


def test_a_goal_is_reached_when_all_updates_it_calls_for_are_made() -> None:
    # Actors are fast: all steps are there long before the updates.
    world = World(chunk_steps=40)
    learner = run(world, steps_goal=903)  # three more than 200 updates call for
    assert world.updates == 200
    assert learner.phases.done
    assert world.goals == {903}


def test_a_run_without_a_goal_takes_that_of_an_earlier_learner_back() -> None:
    world = World()
    world.learner().start()  # before actors can join it
    assert world.goals == {MAX_COUNT}


def test_actors_that_left_at_the_goal_are_not_ahead_of_the_count() -> None:
    world = World(last_update=0)
    found: list[bool] = []

    def watch(*, finished: Callable[[], bool]) -> list[str]:
        if not found:
            found.append(finished())
            world.play(900)  # and they leave, before the learner looks again
            found.append(finished())
            world.stop.set()
        return []

    learner = world.learner(900)
    learner.start()
    learner.run(children_of_local_mode(watch=watch))
    assert found == [False, True]


@pytest.mark.parametrize(
    ("goal", "said"),
    [
        (900, ["The run has its 900 steps already: give more --steps, or omit the flag, to train "
               "on."]),
        (None, ["stopping: writing a checkpoint ..."]),
    ],
)  # fmt: skip
def test_a_run_that_goes_on_at_its_goal_says_so(goal: int | None, said: list[str]) -> None:
    world = World()
    run(world, steps_goal=900)
    assert world.said == []
    again = World(chunks=world.chunks, evaluators=set())
    again.rows, again.first = world.rows, len(world.credited)
    again.stops_at(1)
    learner = again.learner(goal)
    learner.restore(world.checkpoints[-1])
    again.said.clear()
    learner.start()
    learner.run()
    assert again.said == said
    assert again.updates == (goal is None)


def test_updates_wait_for_the_steps_of_the_goal() -> None:
    world = World(chunk_steps=1)
    run(world, steps_goal=500)
    assert world.agent_steps >= 500
    assert world.updates >= 500


def test_the_last_epoch_is_tested_before_the_end() -> None:
    world = World(actors={"a"}, scores=[4.0])
    learner = world.learner(steps_goal=100 + 200 + 100)

    def leave() -> None:
        world.play(12)  # the last chunk, cut short
        world.actors = set()

    learner.start()
    world.once(lambda: "minibatches end" in world.log, leave)
    learner.run()
    phases = [(row.epoch, row.phase, row.steps) for row in world.rows]
    last = world.agent_steps - 300
    assert phases == [(0, "random", 100), (1, "train", 200), (1, "test", 50), (2, "train", last),
                      (2, "test", 50)]  # fmt: skip
    assert "evaluators may leave" in world.log
    assert world.checkpoints[-1]["tests"] == []


def test_the_last_test_may_take_longer_than_a_run_may_stand_still() -> None:
    world = World(test_seconds=1_100.0, checks=(RED,))
    assert run(world, steps_goal=300).failed is None
    assert 2_100.0 < world.now < 2_200.0  # with the minute in which the evaluator may leave
    assert world.rows[-1].phase == "test"


@pytest.mark.parametrize(("steps", "epochs"), [(116, 0), (120, 1), (300, 1), (316, 1), (320, 2)])
def test_less_than_a_tenth_of_an_epoch_at_the_end_is_none(steps: int, epochs: int) -> None:
    world = World(update_seconds=1.0, scores=[4.0])
    run(world, steps_goal=steps)
    assert world.agent_steps == steps
    assert [row.phase for row in world.rows] == ["random", *["train", "test"] * epochs]


def test_without_an_evaluator_the_end_is_not_waited_for() -> None:
    world = World(evaluators=set())
    run(world, steps_goal=300)
    told = "by `ale-robot join --connect tcp/h:1 --evaluator --patience inf`."
    assert world.said[0].startswith("There is no evaluator")
    assert world.said[0].endswith(told)
    assert len(world.checkpoints[-1]["tests"]) == 1  # for one that comes to the resumed run


def test_local_mode_without_evaluators_was_asked_for() -> None:
    world = World(evaluators=set())
    learner = world.learner(steps_goal=300)
    learner.start()
    learner.run(children_of_local_mode())
    assert world.said == []


def test_a_run_that_begins_with_a_recording_has_no_checkpoint_to_be_compared_with() -> None:
    world = World()
    world.play(1_100, DEMONSTRATIONS)
    world.learner().start()
    assert world.said == [
        "The replay begins with 1,100 steps: actors wait until 275 updates have caught up."
    ]


def test_a_local_evaluator_that_has_not_joined_yet_is_waited_for() -> None:
    world = World(evaluators=set())
    world.once(lambda: world.now >= 1_300.0, lambda: world.evaluators.add("e"))
    learner = world.learner(steps_goal=300)
    learner.start()
    learner.run(children_of_local_mode(works=lambda role: role == "evaluator"))
    assert world.said == []
    assert world.rows[-1].phase == "test"


def test_the_loop_tells_its_phase_its_version_and_what_it_skipped() -> None:
    world = World(loss=lambda update: math.nan if update in (30, 31) else 0.5, spoils=False)
    run(world, steps_goal=300)
    phases = [phase for phase, _ in groupby(told["run/phase"] for told in world.told)]
    assert phases == ["warm-up", "training", "finishing"]
    assert world.told[-1]["learning/skipped"] == 2
    assert world.told[-1]["stream/weights_version"] == world.published[-1][1]
    assert {told["learning/skipped"] for told in world.told[:2]} == {0}


def test_demonstrations_that_are_all_the_steps_are_learned_from_and_that_is_tested() -> None:
    world = World(chunk_steps=0)
    world.play(400, DEMONSTRATIONS)
    run(world, steps_goal=300)
    assert [(row.phase, row.epoch, row.steps) for row in world.rows] == [
        ("random", 0, 400),
        ("train", 1, 0),
        ("test", 1, 50),
    ]
    assert world.updates == 50
    assert next(each for each in world.log if each[0] == "test")[1] == 1


def test_a_kill_before_that_test_puts_it_off_to_the_resumed_run() -> None:
    killed = World(chunk_steps=0)
    killed.play(400, DEMONSTRATIONS)
    run(killed, steps_goal=300)
    state = next(each for each in killed.checkpoints if each["rows"] == 1)
    assert state["updates"] == 50
    for again in (False, True):
        world = World(chunks=killed.chunks, chunk_steps=0)
        world.rows, world.first, world.updates = killed.rows[: state["rows"]], 1, 50
        learner = world.learner(steps_goal=300)
        learner.restore(state)
        learner.start()
        assert learner.phases.done
        assert learner.has_tests_to_come is not again  # although none is left at first
        assert not learner.evaluation.pending
        learner.run()
        assert not learner.has_tests_to_come
        rows = [(row.phase, row.epoch, row.steps) for row in world.rows]
        assert rows == [("random", 0, 400), ("train", 1, 0), ("test", 1, 50)]
        killed, state = world, world.checkpoints[-1]  # and that all is tested once


@pytest.mark.parametrize(("steps", "comes"), [(420, True), (312, False)])
def test_the_part_of_an_epoch_with_which_a_resumed_run_ends_is_tested_if_it_is_a_tenth(
    steps: int, comes: bool
) -> None:
    """It was stopped within its second epoch, and is resumed with fewer --steps."""
    world = World()
    world.once(lambda: world.agent_steps >= steps, world.stop.set)
    run(world, steps_goal=900)
    state = world.checkpoints[-1]
    learner = world.learner(steps_goal=300)
    world.stop.clear()
    learner.restore({**state, "tests": []})
    learner.start()
    assert (learner.phases.epoch, learner.phases.phase_steps >= 20) == (2, comes)
    assert learner.has_tests_to_come is comes


def test_a_learner_that_gets_no_minibatch_after_the_last_step_does_not_wait_for_ever() -> None:
    world = World(chunk_steps=0, last_update=10)
    world.play(400, DEMONSTRATIONS)
    learner = world.learner(steps_goal=300)
    learner.start()
    learner.run()
    assert learner.failed is not None
    assert "10 minutes" in learner.failed


def test_an_evaluator_that_plays_nothing_is_not_waited_for_without_end() -> None:
    world = World(test_seconds=math.inf)
    run(world, steps_goal=300)
    assert [said for said in world.said if said.startswith("No evaluator has reported for 20 min")]
    assert 1_200.0 < world.now - world.added < 1_300.0
    assert len(world.checkpoints[-1]["tests"]) == 1  # for one that comes to the resumed run


def test_tests_that_go_on_are_waited_for() -> None:
    world = World(test_seconds=2_500.0)
    learner = world.learner(steps_goal=300)
    for end in (1_900.0, 2_800.0):
        told = partial(setattr, learner.evaluation, "reports", end)
        world.once(partial(lambda end: world.now >= end, end), told)
    learner.start()
    learner.run()
    assert world.now - world.added >= 2_500.0
    assert world.rows[-1].phase == "test"


def resumed_with(more: int) -> tuple[World, Learner, int]:
    """Returns a run that goes on with a replay of so many steps more than its checkpoint, its
    learner, and the steps of the checkpoint."""
    world = World()
    world.stops_at(200)
    run(world)
    known = world.checkpoints[-1]["books"]["agent_steps"]
    again = World(chunks=world.chunks, lost=world.agent_steps - known - more)
    again.rows = world.rows
    again.first = len(world.credited)
    learner = again.learner()
    learner.restore(world.checkpoints[-1])
    return again, learner, known


@pytest.mark.parametrize("beyond", [0, 1])
def test_a_replay_that_lost_more_steps_than_a_warm_up_is_refused(beyond: int) -> None:
    again, learner, known = resumed_with(-100 - beyond)
    if not beyond:
        learner.start()
        return
    with pytest.raises(
        InputError,
        match=rf"has seen {known - 101:,} steps and the learner {known:,}: .*--initial FILE",
    ):
        learner.start()
    assert (again.checkpoints, again.published) == ([], [])


@pytest.mark.parametrize("lost", [90, 160])
def test_a_replay_that_comes_back_with_an_older_folder_ends_the_run(lost: int) -> None:
    """It was in a process of its own. Its new chunks have numbers that are counted already."""
    world = World(update_seconds=0.25)  # some chunks from one look to the next
    world.stops_at(200)
    world.once(lambda: world.updates >= 100, lambda: setattr(world, "lost", lost))
    learner = world.learner()
    learner.start()
    if lost < 100:
        learner.run()
        return
    with pytest.raises(InputError, match=r"the replay has seen 244 steps and the learner 400: "):
        learner.run()
    assert world.checkpoints[-1]["updates"] == world.updates  # what was learned is kept
    assert world.log[-1][0] == "summary"


def test_a_checkpoint_does_not_go_on_with_the_replay_of_another_run() -> None:
    world = World()
    world.stops_at(60)
    run(world)
    state = world.checkpoints[-1]
    assert state["replay"] == "id"
    updated = World().learner()  # whose settings have a field more
    updated.replay.run_id = "id-0123456789abcdef"
    updated.restore(state)
    with pytest.raises(InputError, match=r"^the replay is not the one whose .* counts: put"):
        World().learner().restore(state | {"replay": "another"})
    former = {key: value for key, value in state.items() if key != "replay"}
    World().learner().restore(former)  # a version that did not store it


@pytest.mark.parametrize("more", [1_000, 1_001])
def test_people_are_told_why_actors_wait_after_a_kill(more: int) -> None:
    """The preset lets the updates be 1,000 steps behind."""
    again, learner, _ = resumed_with(more)
    learner.start()
    told = "The replay has 1,001 steps more than the checkpoint: actors wait until 250 updates"
    assert any(said.startswith(told) for said in again.said) == (more > 1_000)


def children_of_local_mode(**calls: Callable[..., Any]) -> Any:
    """Children that do nothing, except for these ``calls``."""
    nothing: dict[str, Callable[..., Any]] = {
        "watch": lambda *, finished: [],
        "at_work": set,
        "works": lambda role: False,
        "ask_to_leave": lambda: None,
        "close": lambda: None,
    }
    return SimpleNamespace(**nothing | calls)


def test_local_modes_children_are_watched_and_asked_to_leave() -> None:
    world = World()
    world.stops_at(60)
    children = children_of_local_mode(
        watch=lambda *, finished: ["actor-1 ended by signal 9, started again"],
        ask_to_leave=lambda: world.log.append("children may leave"),
        close=lambda: world.log.append("children have left"),
    )
    learner = world.learner()
    learner.start()
    learner.run(children)
    assert "actor-1 ended by signal 9, started again" in world.said
    assert world.log[-5:] == [
        "drain",
        "children may leave",
        ("checkpoint", world.updates),
        "children have left",
        ("summary", world.updates),
    ]


def _starting(world: World) -> list[Any]:
    """Returns how many children had not joined at each look."""
    return [told["stream/actors_starting"] for told in world.told]


def test_local_modes_children_are_starting_until_they_join_and_again_after_a_loss() -> None:
    world = World(evaluators=set())
    at_work = {"actor-1", "evaluator-1"}
    world.once(lambda: world.updates >= 100, lambda: world.actors.add("actor-1"))
    world.once(lambda: world.updates >= 200, lambda: world.ended.update({"actor-1": False}))
    world.once(lambda: world.updates >= 300, lambda: world.ended.update({"actor-1": True}))
    world.once(lambda: world.updates >= 400, at_work.clear)  # one that never joined
    world.stops_at(500)
    learner = world.learner()
    learner.start()
    learner.run(children_of_local_mode(at_work=lambda: at_work))
    assert [count for count, _ in groupby(_starting(world))] == [2, 1, 2, 1, 0]
    alone = World()
    alone.stops_at(60)
    run(alone)
    assert {*_starting(alone)} == {0}


def test_the_summary_has_the_last_chunks_of_local_modes_actors() -> None:
    world = World()
    world.stops_at(60)
    learner = world.learner()
    learner.start()
    learner.run(children_of_local_mode(close=lambda: world.play(4)))
    assert world.summed_steps == world.agent_steps


def test_a_stop_keeps_nothing_that_has_just_diverged() -> None:
    world = World(update_seconds=1e-4, loss=lambda update: float("nan") if update > 51 else 0.5)
    world.stops_at(53)
    with pytest.raises(InputError, match="became non-finite at update 52: "):
        run(world)
    assert world.updates >= 53
    assert world.checkpoints[-1]["updates"] == 50
    assert world.log[-1] == ("summary", world.updates)


def test_a_full_disk_at_the_last_checkpoint_costs_neither_summary_nor_children() -> None:
    world = World()

    def fill_up_and_stop() -> None:
        world.full = True
        world.stop.set()

    world.once(lambda: world.updates >= 60, fill_up_and_stop)
    children = children_of_local_mode(ask_to_leave=lambda: world.log.append("children may leave"))
    learner = world.learner()
    learner.start()
    with pytest.raises(OSError, match="No space left"):
        learner.run(children)
    assert world.log[-4:] == [
        *("minibatches end", "drain", "children may leave"),
        ("summary", world.updates),
    ]


def test_children_that_cannot_start_end_the_run_with_everything_kept() -> None:
    world = World()

    def watch(*, finished: Callable[[], bool]) -> list[str]:
        raise InputError("actor-1 cannot start")

    learner = world.learner()
    learner.start()
    with pytest.raises(InputError, match="cannot start"):
        learner.run(children_of_local_mode(watch=watch))
    assert world.log[-2:] == [("checkpoint", world.updates), ("summary", world.updates)]
