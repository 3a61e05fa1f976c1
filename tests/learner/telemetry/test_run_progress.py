"""Phases counted from the facts of chunks, by hand."""

from dataclasses import replace

import pytest

from common.protocol.chunk import Game
from common.run.config import ProtocolConfig, ReplayConfig, RunConfig
from learner.telemetry.run_progress import RunProgress
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
                "games": (Game(float(index), 10),),
            }
            | more
        )
        for index in range(first, first + count)
    ]


def test_warm_up_then_epochs() -> None:
    progress = RunProgress(CONFIG)
    ends = list(progress.book(_chunks(11)))
    assert [(end.epoch, end.steps, end.scores) for end in ends] == [
        (0, 100, (0.0, 1.0)),
        (1, 200, (2.0, 3.0, 4.0, 5.0)),
        (2, 200, (6.0, 7.0, 8.0, 9.0)),
    ]
    assert (progress.epoch, progress.phase_steps, progress.agent_steps, progress.train_steps) == (
        3,
        50,
        550,
        450,
    )
    assert progress.games == 9  # those of the warm-up do not count as training
    values = progress.values(finishing=False)
    assert values["play/train_reward"] == pytest.approx(sum(range(2, 11)) / 9)
    assert values["play/valid_frame_share"] == 1.0
    assert values["play/press_match_share"] == 0.5
    assert values["stream/staleness_p50"] == 5.0
    assert values["stream/staleness_p95"] == 9.5
    assert (values["run/phase_steps"], values["run/phase_length"]) == (50, 200)
    assert (values["run/epoch"], values["run/agent_steps"]) == (3, 550)


def test_shares_are_over_the_newest_chunks() -> None:
    progress = RunProgress(CONFIG)
    list(progress.book(_chunks(20, valid=0)))
    list(progress.book(_chunks(60, first=20)))
    assert progress.values(finishing=False)["play/valid_frame_share"] == 0.75
    list(progress.book(_chunks(20, first=80)))
    assert progress.values(finishing=False)["play/valid_frame_share"] == 1.0


def test_facts_that_were_seen_before_count_once() -> None:
    progress = RunProgress(CONFIG)
    list(progress.book(_chunks(3)))
    list(progress.book(_chunks(3)))
    list(progress.book(_chunks(2, first=2)))
    assert (progress.agent_steps, progress.epoch, progress.phase_steps) == (200, 1, 100)


def test_it_goes_on_from_its_state() -> None:
    whole, first, second = (RunProgress(CONFIG) for _ in range(3))
    expected = list(whole.book(_chunks(20)))
    ends = list(first.book(_chunks(9)))
    second.restore(first.state())
    ends += second.book(_chunks(20))
    assert ends == expected
    assert second.state() == whole.state()


def test_an_end_that_is_asked_for_starts_the_next_phase() -> None:
    progress = RunProgress(CONFIG)
    list(progress.book(_chunks(3)))
    ended = progress.close_phase()
    assert (ended.epoch, ended.steps) == (1, 50)
    (next_end,) = progress.book(_chunks(5, first=3))
    assert (next_end.epoch, next_end.steps) == (2, 200)


def test_at_the_very_end_the_last_epoch_is_told_whole() -> None:
    progress = RunProgress(CONFIG)
    list(progress.book(_chunks(6)))
    shown = ("run/epoch", "run/phase_steps", "run/phase_length")
    for finishing, expected in ((False, [2, 0, 200]), (True, [1, 200, 200])):
        values = progress.values(finishing=finishing)
        assert [values[key] for key in shown] == expected
