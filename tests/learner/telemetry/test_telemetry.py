"""Figures from where they are known to every sink, on a clock that the test turns."""

import errno
import json
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from common.errors import InputError
from common.metrics import METRICS, Metric, Value, declare
from common.press_latency import COUNTS, place_of
from common.process.footprint import footprint
from common.protocol.actor_stats import ActorStats
from common.protocol.chunk import Game
from common.run.epochs import EpochTable
from common.settings.presets import PRESETS
from common.transport.interface import Envelope, Transport
from learner.phases import Phases
from learner.run_clock import RunClock
from learner.telemetry.actor_registry import ActorRegistry
from learner.telemetry.sinks.gates_csv import GatesCsvSink
from learner.telemetry.sinks.sink import Sink
from learner.telemetry.sinks.summary import SummarySink
from learner.telemetry.sinks.tensorboard import TensorBoardSink
from learner.telemetry.snapshot import ActorView, Histogram, Snapshot
from learner.telemetry.telemetry import Telemetry
from replay.chunk_statistics import ChunkStatistics, ReplayProgress
from tests.epoch_rows import epoch_row
from tests.learner.conftest import KEYS
from tests.learner.telemetry.sinks.test_display import drawn
from tests.learner.telemetry.sinks.test_tensorboard import read

CONFIG = replace(
    PRESETS["fast"],
    replay=replace(PRESETS["fast"].replay, learning_starts=100),
    protocol=replace(PRESETS["fast"].protocol, epoch_steps=200),
)
LOOP: dict[str, Value] = {"run/phase": "training", "run/seconds": 60.0}


def chunk(index: int, incarnation: int = 7) -> ChunkStatistics:
    return ChunkStatistics(
        index, 50 * (index + 1), 50, "a", 1.0, 0, 0, 50, 50, (), incarnation=incarnation
    )


class Last(Sink):
    """Keeps what it is told."""

    period = 1.0

    def __init__(self) -> None:
        self.told: list[Any] = []

    def watch(self, feed: Any) -> None:
        self.feed = feed

    def start(self, resumed_at: int | None) -> None:
        self.told.append(("start", resumed_at))

    def write(self, snapshot: Snapshot) -> None:
        self.told.append(snapshot)

    def phase(self, row: Any, agent_steps: int) -> None:
        self.told.append((row.phase, agent_steps))

    def event(self, text: str) -> None:
        self.told.append(text)


PLAYS = ActorView(stats=ActorStats("a", "actor", steps_per_second=99.0), alive=True)


class Run:
    """A run that has seen `seen` chunks of 50 steps, and what its telemetry says."""

    def __init__(
        self,
        folder: Path,
        registry: Any = None,
        sinks: tuple[Sink, ...] = (),
        max_q: Histogram | None = None,
        **more: Any,
    ) -> None:
        self.now = 1_000.0
        self.actors: tuple[ActorView, ...] = ()
        self.phases = Phases(CONFIG, RunClock(lambda: self.now))
        self.replay = ReplayProgress(0, 0, 0, 0, 0, 0, False, 0, 0, 0, ())
        self.last = Last()
        self.table = EpochTable(folder / "epochs.csv")
        known: Any = registry or SimpleNamespace(
            take_notes=list, actors=lambda: self.actors, totals=lambda: ({}, ())
        )
        self.telemetry = Telemetry(
            CONFIG,
            {"run/run": "r", "run/device": "cpu"},
            self.phases,
            known,
            SimpleNamespace(histogram=max_q, values=lambda: {"learning/mean_max_q": 2.5}),  # type: ignore[arg-type]
            self.table,
            (self.last, *sinks),
            SimpleNamespace(close=lambda: self.last.told.append("no more pictures")),  # type: ignore[arg-type]
            lambda: self.now,
            **more,
        )

    def play(self, chunks: int) -> None:
        seen = self.phases.chunks_seen
        for index in range(seen, seen + chunks):
            if self.phases.count(chunk(index)):
                self.phases.close(self.phases.result(stored=0, meanq=None)[0])

    def values(self, **loop: Value) -> Any:
        """The figures after one second more."""
        self.now += 1.0
        self.telemetry.report({**LOOP, **loop}, self.replay)
        return self.last.told[-1].values


@pytest.fixture
def toy() -> Iterator[str]:
    """A figure that is declared outside the table."""
    key = "toy/mood"
    shown: dict[str, Any] = {"label": "mood", "panel": ("Reward", 0), "curve": True}
    written: dict[str, Any] = {"gate": "mood", "summary": "moods.present"}
    declare(Metric(key, "ratio", ".2", "How the run feels", **shown, **written))
    yield key
    del METRICS[key]


def test_a_figure_reaches_every_sink_by_its_declaration_and_its_value(
    tmp_path: Path, toy: str
) -> None:
    sinks = (
        TensorBoardSink(tmp_path / "tensorboard", {}),
        GatesCsvSink(tmp_path / "gates.csv"),
        SummarySink(tmp_path / "summary.json", CONFIG, {}),
    )
    run = Run(tmp_path, sinks=sinks)
    run.telemetry.start()
    run.values(**{toy: 0.75})
    assert any("mood" in line and "0.75" in line for line in drawn(run.last.told[-1]))
    run.telemetry.close({**LOOP, toy: 0.5}, run.replay)
    points = read(tmp_path / "tensorboard")
    assert points["toy/mood"] == points["gates/mood"] == [(0, 0.75), (0, 0.5)]
    header, *rows = (tmp_path / "gates.csv").read_text().splitlines()
    moods = [dict(zip(header.split(","), row.split(","), strict=True))["mood"] for row in rows]
    assert moods == ["0.75", "0.5"]
    assert json.loads((tmp_path / "summary.json").read_text())["moods"] == {"present": 0.5}


def test_a_figure_that_nobody_declared_is_refused(tmp_path: Path) -> None:
    run = Run(tmp_path)
    with pytest.raises(KeyError, match=r"declare \['toy/mood'\] in common/metrics"):
        run.values(**{"toy/mood": 1.0})


def test_chunks_that_were_stored_twice_are_shown_and_fail_a_check(
    tmp_path: Path, hub: Transport
) -> None:
    """As without deduplication: sums over all actors balance, since one that died made more."""
    registry = ActorRegistry(hub, KEYS)
    run = Run(tmp_path, registry)

    def say(**counters: Any) -> None:
        stats = ActorStats("a", "actor", **counters)
        registry._on_stats(Envelope(stats.encode(), key=KEYS.stats("actor", "a")))

    for index in range(20):
        registry.accepted(chunk(index))
    say(incarnation=7, made=10, acked=10, leaving=True)
    run.replay = replace(run.replay, accepted=20)
    values = run.values()
    names = ("made", "acked", "refused", "excess")
    assert [values[f"stream/chunks_{name}"] for name in names] == [10, 20, 0, 10]
    (check,) = (each for each in run.last.told[-1].failed)
    assert (check.name, check.value, check.stops) == ("excess chunks", 10.0, False)
    assert values["gates/failed"] == 1


def test_max_q_is_that_of_the_held_out_states(tmp_path: Path) -> None:
    assert Run(tmp_path).values()["learning/mean_max_q"] == 2.5


def test_histograms_are_those_that_are_known(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.values()
    assert run.last.told[-1].histograms == {}
    counts = [0] * COUNTS
    counts[place_of("press", True, 3)] = 7
    counts[place_of("press", False, 5)] = 2  # given up
    counts[place_of("release", True, 1)] = 4
    registry = SimpleNamespace(take_notes=list, actors=tuple, totals=lambda: ({}, tuple(counts)))
    max_q = Histogram([1, 2], [0.0, 0.5, 1.0])
    run = Run(tmp_path, registry, max_q=max_q)
    run.values()
    found = run.last.told[-1].histograms
    assert found.keys() == {"learning/max_q", "hands/press_ms", "hands/release_ms"}
    assert found["learning/max_q"] is max_q
    press = found["hands/press_ms"]
    assert (press.counts[2], sum(press.counts)) == (7, 7)
    assert (press.edges[2], press.edges[3]) == (pytest.approx(100 / 3), 50.0)
    assert (found["hands/release_ms"].counts[0], sum(found["hands/release_ms"].counts)) == (4, 4)


def test_an_event_is_told_once_and_kept_for_the_screen(tmp_path: Path) -> None:
    arrivals = [["a1 joined"], [], ["a1 left"]]
    run = Run(
        tmp_path,
        SimpleNamespace(take_notes=lambda: arrivals.pop(0), actors=tuple, totals=lambda: ({}, ())),
    )
    run.values()
    run.telemetry.note("actor-1 ended by signal 9, started again")
    run.values()
    run.values()
    events = [each for each in run.last.told if isinstance(each, str)]
    assert events == ["a1 joined", "actor-1 ended by signal 9, started again", "a1 left"]
    assert run.last.told[-1].notes == tuple(events)


def test_rates_are_of_late_and_over_whole_phases(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.phases.epoch = 1
    assert run.values()["stream/steps_per_second"] is None
    run.play(2)
    run.phases.updates = 40
    run.now += 9.0
    values = run.values()
    assert (values["stream/steps_per_second"], values["learning/updates_per_second"]) == (10.0, 4.0)
    # Before the first epoch is over, the rate of the moment stands in.
    assert values["run/train_steps_per_second"] == 10.0
    assert values["run/epochs_per_day"] is None
    run.telemetry.add(epoch_row((1.0,), phase="train", steps=250, epoch_time=1.0))
    run.telemetry.add(epoch_row((2.0,), phase="test", steps=500, epoch_time=1.0))
    values = run.values()
    assert (values["run/train_steps_per_second"], values["run/test_steps_per_second"]) == (250, 500)
    # 250,000 / 250 + 125,000 / 500 = 1,250 s; 86,400 / 1,250, whatever the run's own epochs are
    assert values["run/epochs_per_day"] == 69.12
    run.now += 14.0
    assert run.values()["stream/steps_per_second"] == 0.0


def test_the_warm_up_tells_nothing_of_how_long_training_takes(tmp_path: Path) -> None:
    run = Run(tmp_path)
    goal: dict[str, Value] = {"run/steps_goal": 1_000}
    run.phases.epoch = 0
    run.values(**goal)
    run.phases.agent_steps += 400
    run.now += 3.0
    values = run.values(**goal)
    assert (values["stream/steps_per_second"], values["run/seconds_to_goal"]) == (100.0, None)
    assert values["run/train_steps_per_second"] is None
    run.phases.epoch = 1
    values = run.values(**goal)
    assert (values["stream/steps_per_second"], values["run/seconds_to_goal"]) == (None, None)
    run.actors = (PLAYS,)
    run.phases.agent_steps += 30
    run.now += 2.0
    values = run.values(**goal)
    left = 1_000 - run.phases.agent_steps
    assert (values["stream/steps_per_second"], values["run/seconds_to_goal"]) == (10.0, left / 10)


@pytest.mark.parametrize("resumed_at", [None, 700])
def test_while_the_first_actor_starts_no_time_left_is_told(
    tmp_path: Path, resumed_at: int | None
) -> None:
    run = Run(tmp_path)
    run.actors = (PLAYS,)
    run.phases.epoch, run.phases.agent_steps = 1, resumed_at or 0
    run.telemetry.start(resumed_at=resumed_at)
    goal: dict[str, Value] = {"run/steps_goal": run.phases.agent_steps + 1_000}
    for _ in range(3):
        assert run.values(**goal)["run/seconds_to_goal"] is None
        run.now += 5.0
    run.values(**goal)
    run.phases.agent_steps += 100
    run.now += 1.0
    values = run.values(**goal)
    assert (values["stream/steps_per_second"], values["run/seconds_to_goal"]) == (50.0, 18.0)
    assert values["run/seconds_left"] is not None


def test_no_time_left_is_told_when_nobody_plays_any_more(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.phases.epoch, run.actors = 1, (PLAYS,)
    goal: dict[str, Value] = {"run/steps_goal": 1_000}
    run.values(**goal)
    run.play(3)
    assert run.values(**goal)["run/seconds_to_goal"] is not None
    run.actors = (replace(PLAYS, alive=False),)
    values = run.values(**goal)
    assert (values["run/seconds_left"], values["run/seconds_to_goal"]) == (None, None)


def test_what_the_learner_takes_of_its_machine_is_of_late(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, worked = Run(tmp_path), [7.0]
    run.phases.agent_steps = 1  # before, it waits
    monkeypatch.setattr("learner.telemetry.telemetry.time.process_time", lambda: worked[0])
    values = run.values()
    assert values["run/busy_cores"] is None
    assert values["run/memory_bytes"] == pytest.approx(footprint().private, rel=0.5)
    worked[0], run.now = 13.0, run.now + 3.0
    assert run.values()["run/busy_cores"] == 1.5


def test_what_is_taken_of_the_gpu_is_among_the_figures(tmp_path: Path) -> None:
    told: dict[str, Value] = {"run/gpu_memory_bytes": 3}
    run = Run(tmp_path, gpu=lambda: told)
    assert run.values()["run/gpu_memory_bytes"] == 3
    told = {"run/gpu_memory_bytes": 4}
    assert run.values()["run/gpu_memory_bytes"] == 4
    assert "run/gpu_memory_bytes" not in Run(tmp_path).values()


def test_time_left_is_of_the_phase_and_then_of_the_tests(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.phases.epoch, run.actors = 1, (PLAYS,)
    run.values()
    run.play(3)
    run.now += 4.0
    assert run.values()["run/seconds_left"] == (200 - 150) / 30
    assert run.values()["run/seconds_to_goal"] is None
    for played, left in ((910, 90), (1_020, 0)):
        run.phases.agent_steps = played
        values = run.values(**{"run/steps_goal": 1_000})
        rate = values["stream/steps_per_second"]
        assert isinstance(rate, float)
        assert values["run/seconds_to_goal"] == pytest.approx(left / rate)
    evaluator = ActorStats("e", "evaluator", steps_per_second=20.0)
    run.actors = ActorView(stats=evaluator, alive=True), PLAYS
    loop: dict[str, Value] = {"run/phase": "finishing", "evaluation/steps_left": 300}
    assert run.values(**loop)["run/seconds_left"] == 15.0
    run.telemetry.rows.append(epoch_row(phase="test", steps=1_000, epoch_time=100.0))
    assert run.values(**loop)["run/seconds_left"] == 30.0  # at 10 steps/s, as in whole tests


def test_a_network_that_has_not_explored_is_not_compared_with_a_blind_one(tmp_path: Path) -> None:
    run = Run(tmp_path)
    told: dict[str, Value] = {"learning/relative_td_error": 3.0}
    assert run.values(**told)["learning/relative_td_error"] is None
    run.phases.agent_steps = 99 + CONFIG.exploration.steps
    assert run.values(**told)["learning/relative_td_error"] is None
    run.phases.agent_steps += 1
    assert run.values(**told)["learning/relative_td_error"] == 3.0


def test_rewards_are_those_of_the_rows(tmp_path: Path) -> None:
    run = Run(tmp_path)
    for row in (
        epoch_row((-21.0,), phase="random"),
        epoch_row((-20.0,), phase="train", epoch=1),
        epoch_row((5.0,), phase="test", epoch=1),
        epoch_row((3.0,), phase="test", epoch=2),
        epoch_row((), phase="test", epoch=3),
    ):
        run.telemetry.add(row)
    values = run.values()
    names = ("random_reward", "test_reward", "best_test_reward", "test_epoch")
    assert [values[f"play/{name}"] for name in names] == [-21.0, 3.0, 5.0, 2]
    assert run.last.told[-1].rewards["test"] == (5.0, 3.0)
    assert ("test", 100) in run.last.told  # its weights have no training steps


def test_the_score_of_random_play_is_told_while_it_is_played(tmp_path: Path) -> None:
    run = Run(tmp_path)
    assert run.values()["play/random_reward"] is None
    run.phases.count(chunk(0)._replace(games=(Game(-19.0, 10), Game(-20.0, 10))))
    assert run.values()["play/random_reward"] == -19.5
    run.telemetry.add(epoch_row((-21.0,), phase="random"))
    assert run.values()["play/random_reward"] == -21.0


def test_a_resumed_run_keeps_the_rows_of_its_checkpoint(tmp_path: Path) -> None:
    first = Run(tmp_path)
    first.telemetry.start()
    for epoch in (1, 2, 3):
        first.telemetry.add(epoch_row((1.0,), phase="train", epoch=epoch))
    second = Run(tmp_path)
    second.telemetry.start(rows=2, resumed_at=700)
    assert [row.epoch for row in second.telemetry.rows] == [1, 2]
    assert second.table.rows() == second.telemetry.rows
    assert (first.last.told[0], second.last.told[0]) == (("start", None), ("start", 700))


def test_each_sink_has_its_own_schedule(tmp_path: Path) -> None:
    slow = Last()
    slow.period = 5.0
    run = Run(tmp_path, sinks=(slow,))
    for _ in range(12):
        run.values()
    assert len(slow.told) == 3
    assert len(run.last.told) == 12


class Refusing(Last):
    """Cannot write what the disk refuses."""

    def __init__(self, *refused: str) -> None:
        super().__init__()
        self.refused = [*refused]

    def start(self, resumed_at: int | None) -> None:
        self._ask("start")
        super().start(resumed_at)

    def write(self, snapshot: Snapshot) -> None:
        self._ask("write")
        super().write(snapshot)

    def close(self) -> None:
        self._ask("close")
        self.told.append("closed")

    def _ask(self, what: str) -> None:
        if what in self.refused:
            self.refused.remove(what)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_what_a_full_disk_refuses_is_written_by_the_next_try(tmp_path: Path) -> None:
    slow = Refusing("write")
    slow.period = 60.0
    run = Run(tmp_path, sinks=(slow,))
    with pytest.raises(OSError, match="No space"):
        run.values()
    run.telemetry.report(LOOP, run.replay)
    run.telemetry.report(LOOP, run.replay)
    assert len(slow.told) == len(run.last.told) == 1


def test_sinks_see_pictures_until_the_last_figures(tmp_path: Path) -> None:
    run = Run(tmp_path)
    assert run.last.feed is run.telemetry.feed
    run.telemetry.start()
    run.telemetry.close(LOOP, run.replay)
    _, told, last = run.last.told
    assert (told, type(last)) == ("no more pictures", Snapshot)


def test_every_sink_is_closed_whatever_another_one_meets(tmp_path: Path) -> None:
    first, second, third = Refusing("write"), Refusing("close"), Refusing()
    run = Run(tmp_path, sinks=(first, second, third))
    run.telemetry.start()
    with run.telemetry, pytest.raises(OSError, match="No space"):
        run.telemetry.close(LOOP, run.replay)
    assert [len(each.told) for each in (first, second, third)] == [2, 2, 3]
    assert first.told[1:] == third.told[2:] == ["closed"]


def test_sinks_are_closed_in_their_order_each_after_its_last_figures(tmp_path: Path) -> None:
    """Films before the sinks that receive them."""
    happened: list[tuple[str, str]] = []

    def sink(name: str) -> Any:
        return SimpleNamespace(
            period=1.0,
            watch=lambda feed: None,
            start=lambda resumed_at: None,
            write=lambda snapshot: happened.append((name, "written")),
            close=lambda: happened.append((name, "closed")),
        )

    run = Run(tmp_path, sinks=(sink("films"), sink("curves")))
    run.telemetry.start()
    run.telemetry.close(LOOP, run.replay)
    whole = [("films", "written"), ("films", "closed"), ("curves", "written"), ("curves", "closed")]
    assert happened == whole


def test_every_sink_is_closed_where_the_last_figures_cannot_be_had(tmp_path: Path) -> None:
    def broken() -> Any:
        raise RuntimeError("CUDA error")

    sink = Refusing()
    run = Run(tmp_path, sinks=(sink,), gpu=broken)
    run.telemetry.start()
    with pytest.raises(RuntimeError, match="CUDA error"):
        run.telemetry.close(LOOP, run.replay)
    assert sink.told == [("start", None), "closed"]
    assert run.last.told[-1] == "no more pictures"


def test_a_start_that_fails_closes_what_it_has_opened(tmp_path: Path) -> None:
    opened, refused, never = Refusing(), Refusing("start"), Refusing()
    run = Run(tmp_path, sinks=(opened, refused, never))
    with pytest.raises(OSError, match="No space"):
        run.telemetry.start()
    assert (opened.told, refused.told, never.told) == ([("start", None), "closed"], [], [])
    assert run.last.told[-1] == "no more pictures"


def test_what_is_open_after_a_start_is_closed_once_at_the_end_of_the_block(tmp_path: Path) -> None:
    sink = Refusing()
    run = Run(tmp_path, sinks=(sink,))
    run.telemetry.start()
    with pytest.raises(InputError), run.telemetry:
        raise InputError("the replay has lost steps.")
    with run.telemetry:
        pass
    assert sink.told == [("start", None), "closed"]
