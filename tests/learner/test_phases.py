"""Phases counted from the statistics of chunks, and their rows, by hand."""

import math
from dataclasses import replace

import pytest
import torch

from common.protocol.chunk import Game
from common.protocol.run_keys import DEMONSTRATIONS
from common.run.epochs import EpochRow
from common.settings.config import ProtocolConfig, ReplayConfig, RunConfig
from learner.phases import Phases
from learner.run_clock import RunClock
from replay.chunk_statistics import ChunkStatistics

CONFIG = replace(
    RunConfig(),
    replay=replace(ReplayConfig(), learning_starts=100),
    protocol=replace(ProtocolConfig(), epoch_steps=200),
)


def _chunks(count: int, first: int = 0, steps: int = 50, **more: object) -> list[ChunkStatistics]:
    return [
        ChunkStatistics(
            **{  # type: ignore[arg-type]
                "index": index,
                "agent_steps": (index + 1) * steps,
                "steps": steps,
                "actor": "a",
                "epsilon": 1.0,
                "weights_version": 0,
                "staleness": index,
                "valid": steps,
                "matched": steps // 2,
                "follows": steps // 5,
                "games": (Game(float(index), 10),),
            }
            | more
        )
        for index in range(first, first + count)
    ]


def phases(seconds: float = 0.0) -> Phases:
    """Those of a run that has gone on for so long."""
    times = iter((0.0,))
    return Phases(CONFIG, RunClock(lambda: next(times, seconds)))


def count(counted: Phases, chunks: list[ChunkStatistics]) -> list[EpochRow]:
    """The rows of the phases that are complete."""
    return [ended(counted) for chunk in chunks if counted.count(chunk)]


def ended(counted: Phases) -> EpochRow:
    """The row of the present phase, after which the next one begins."""
    row, _ = counted.result(stored=0, meanq=None)
    counted.close(row)
    return row


def test_warm_up_then_epochs() -> None:
    counted = phases()
    rows = count(counted, _chunks(11))
    shown = [(row.epoch, row.steps, row.min_game_reward, row.max_game_reward) for row in rows]
    assert shown == [(0, 100, 0.0, 1.0), (1, 200, 2.0, 5.0), (2, 200, 6.0, 9.0)]
    assert [row.nr_games for row in rows] == [2, 4, 4]
    assert (counted.epoch, counted.phase_steps, counted.agent_steps, counted.train_steps) == (
        3,
        50,
        550,
        450,
    )
    assert counted.games == 9  # those of the warm-up do not count as training
    counted.updates = 90
    values = counted.values()
    assert values["learning/updates"] == 90
    assert values["stream/samples_per_insert"] == 6.4  # 90 minibatches of 32, by 450 steps
    assert values["play/train_reward"] == pytest.approx(sum(range(2, 11)) / 9)
    assert values["play/valid_frame_share"] == 1.0
    assert values["play/following_frame_share"] == 0.2
    assert values["play/press_match_share"] == 0.5
    assert values["stream/staleness_p50"] == 5.0
    assert values["stream/staleness_p95"] == 9.5
    assert (values["run/phase_steps"], values["run/phase_length"]) == (50, 200)
    assert values["run/epoch"] == 3


def test_demonstrations_end_no_phase_however_many_they_are() -> None:
    counted = phases()
    assert count(counted, _chunks(11, actor=DEMONSTRATIONS)) == []
    assert (counted.epoch, counted.agent_steps) == (0, 550)
    ends = count(counted, _chunks(5, first=11))
    assert [(end.epoch, end.steps) for end in ends] == [(0, 600), (1, 200)]


def test_shares_are_over_the_newest_chunks_and_the_reward_over_the_newest_games() -> None:
    counted = phases()
    count(counted, _chunks(20, valid=0))
    count(counted, _chunks(60, first=20))
    assert counted.values()["play/valid_frame_share"] == 0.75
    count(counted, _chunks(20, first=80))
    values = counted.values()
    assert values["play/valid_frame_share"] == 1.0
    assert values["play/train_reward"] == 74.5  # of 50 to 99


def test_it_goes_on_from_its_state() -> None:
    whole, first, second = (phases(seconds=80.0) for _ in range(3))
    for counted in (whole, first):
        counted.add(torch.tensor(2.0))
    expected = count(whole, _chunks(9))
    rows = count(first, _chunks(9))
    for counted in (whole, first):
        counted.add(torch.tensor(3.0))
    second.restore(first.state())
    for counted in (whole, second):
        counted.add(torch.tensor(5.0))
    expected += count(whole, _chunks(11, first=9))
    rows += count(second, _chunks(11, first=9))
    assert [row.meancost for row in rows] == [2.0, 0.0, 4.0, 0.0, 0.0]
    assert rows == expected
    assert second.state() == whole.state()
    assert second.state()["phase_began"] == 80.0


def test_an_end_that_is_asked_for_starts_the_next_phase() -> None:
    counted = phases()
    count(counted, _chunks(3))
    row = ended(counted)
    assert (row.epoch, row.steps) == (1, 50)
    (following,) = count(counted, _chunks(5, first=3))
    assert (following.epoch, following.steps) == (2, 200)


def test_at_the_very_end_the_last_epoch_is_told_whole() -> None:
    shown = ("run/epoch", "run/phase_steps", "run/phase_length")
    for goal, expected in ((None, [2, 0, 200]), (301, [2, 0, 1]), (300, [1, 200, 200])):
        counted = Phases(CONFIG, RunClock(lambda: 0.0), goal)
        count(counted, _chunks(6))
        values = counted.values()
        assert [values[key] for key in shown] == expected
    count(counted, _chunks(1, first=6))  # a few more, which are no epoch of their own
    values = counted.values()
    assert [values[key] for key in shown] == [2, 50, 50]


def test_a_run_that_ends_within_an_epoch_tells_how_much_of_it_there_will_be() -> None:
    times = iter((0.0,))
    counted = Phases(CONFIG, RunClock(lambda: next(times, 0.0)), 450)
    shown = ("run/phase_steps", "run/phase_length")
    left = []
    for chunk in _chunks(9):  # the warm-up of 100 steps, an epoch of 200, and one of 150
        if counted.count(chunk):
            ended(counted)
        values = counted.values()
        left.append((*(values[key] for key in shown), counted.steps_left))
    assert left[:3] == [(50, 100, 50), (0, 200, 200), (50, 200, 150)]
    assert left[5:] == [(0, 150, 150), (50, 150, 100), (100, 150, 50), (150, 150, 0)]
    ended(counted)
    values = counted.values()
    assert [values[key] for key in shown] == [150, 150]


def test_the_rows_of_a_phase_and_of_its_snapshots_test() -> None:
    counted = phases(seconds=80.0)
    for loss in (1.0, 3.0):
        counted.add(torch.tensor(loss))
    count(counted, _chunks(5))
    assert counted.count(_chunks(1, first=5)[0])
    row, test = counted.result(stored=290, meanq=0.75)
    assert (row.epoch, row.phase, row.steps, row.nr_games) == (1, "train", 200, 4)
    assert (row.total_train_steps, row.replay_memory_count, row.meanq) == (200, 290, 0.75)
    assert (row.weight_updates, row.meancost) == (2, 0.0)  # both were in the warm-up
    assert (row.total_time, row.epoch_time) == (80.0, 0.0)
    assert row.last_exploration_rate == CONFIG.epsilon_at(300)
    played = replace(test, steps=60, scores=[5.0, 8.0], began=50.0)
    tested = counted.end_test(played)
    assert (tested.phase, tested.average_reward, tested.steps_per_second) == ("test", 6.5, 2.0)
    same = ("epoch", "total_train_steps", "replay_memory_count", "meanq", "weight_updates")
    assert [getattr(tested, name) for name in same] == [getattr(row, name) for name in same]
    assert tested.last_exploration_rate == CONFIG.protocol.test_epsilon
    assert counted.end_test(replace(played, began=None)).epoch_time == 0.0


def test_the_warm_up_has_no_training_steps_even_if_it_is_longer_than_asked() -> None:
    counted = phases()
    (row,) = count(counted, _chunks(2, steps=60))
    assert (row.steps, row.total_train_steps, counted.train_steps) == (120, 0, 20)
    assert phases().values()["stream/samples_per_insert"] is None


@pytest.mark.parametrize(("epsilon", "phase"), [(1.0, "random"), (0.99, "train")])
def test_a_warm_up_is_random_if_nothing_else_plays(epsilon: float, phase: str) -> None:
    """A run may begin with a network that plays."""
    exploration = replace(CONFIG.exploration, start=epsilon)
    counted = Phases(replace(CONFIG, exploration=exploration), RunClock(lambda: 0.0))
    assert counted.random_reward is None  # no game is over
    counted.count(_chunks(1, first=7)[0])
    assert counted.random_reward == (7.0 if phase == "random" else None)
    assert [row.phase for row in count(counted, _chunks(1, first=8))] == [phase]
    assert counted.random_reward is None  # the warm-up is over
    counted.count(_chunks(1)[0])
    assert counted.random_reward is None


def test_a_phases_loss_is_the_mean_over_its_updates() -> None:
    counted = phases()
    for loss in (1.0, 8.0, math.nan, math.inf, -math.inf, 3.0):  # those between were skipped
        counted.add(torch.tensor(loss))
    (row,) = count(counted, _chunks(2))
    assert row.meancost == 2.0
    for loss in (4.0, 5.0):
        counted.add(torch.tensor(loss))
    (row,) = count(counted, _chunks(4, first=2))
    assert row.meancost == 4.5


def test_a_phase_begins_where_the_row_of_the_one_before_ends() -> None:
    now = [0.0]
    counted = Phases(CONFIG, RunClock(lambda: now[0]))
    now[0] = 7.0
    row, _ = counted.result(stored=0, meanq=None)
    now[0] = 12.0  # the row is written late, such as to a full disk
    counted.close(row)
    now[0] = 20.0
    following, _ = counted.result(stored=0, meanq=None)
    assert (row.epoch_time, following.epoch_time, following.total_time) == (7.0, 13.0, 20.0)


def test_steps_of_chunks_whose_statistics_are_gone_count() -> None:
    counted = phases()
    first, last = *_chunks(1), *_chunks(1, first=9, agent_steps=120)
    assert not counted.count(first)
    assert counted.count(last)  # the warm-up of 100 steps is over
    assert (counted.agent_steps, counted.phase_steps) == (120, 120)
