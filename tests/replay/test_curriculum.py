"""How far the curriculum has gone, chunk by chunk."""

from collections.abc import Iterable
from dataclasses import replace

import pytest

from common.protocol.chunk import Game
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from replay.chunk_statistics import ChunkStatistics
from replay.curriculum import curriculum_steps

WARM_UP = 100
STEPS = 10


def config(score: float | None) -> RunConfig:
    usual = PRESETS["robot"]
    learning = replace(usual.learning, curriculum_steps=1_000, curriculum_score=score)
    return replace(usual, learning=learning, replay=replace(usual.replay, learning_starts=WARM_UP))


def played(scores: Iterable[tuple[float, ...]], gone: int = 500) -> list[ChunkStatistics]:
    """Chunks after each of which the curriculum is ``gone`` steps on."""
    return [
        ChunkStatistics(
            *(0, 0, STEPS, "a", 0.1, 0, 0, STEPS, STEPS),
            games=tuple(Game(score, 900) for score in each),
            curriculum_steps=gone,
        )
        for each in scores
    ]


@pytest.mark.parametrize(
    ("agent_steps", "gone"), [(WARM_UP - 5, 0), (WARM_UP, 0), (WARM_UP + 7, 7), (9_999, 9_899)]
)
def test_without_a_score_it_goes_on_with_the_runs_steps(agent_steps: int, gone: int) -> None:
    past = played([(-21.0,)], gone=3)
    assert curriculum_steps(config(None), past, agent_steps, STEPS) == gone


@pytest.mark.parametrize(
    ("scores", "moved"),
    [
        ([], 0),
        ([()], 0),  # no game has ended yet
        ([(5.0,)], STEPS),
        ([(4.9,)], -STEPS),
        ([(4.0,), (), (6.0,)], STEPS),
        ([(-21.0,), *5 * [(5.0,)]], STEPS),  # only the last five count
        ([(-21.0,), *4 * [(5.0,)]], -STEPS),
        ([(-21.0, *4 * (5.0,)), (5.0,)], STEPS),  # and those of one chunk in their order
    ],
)
def test_it_grows_from_a_score_on_and_shrinks_below(
    scores: list[tuple[float, ...]], moved: int
) -> None:
    found = curriculum_steps(config(5.0), played(scores), 10_000, STEPS)
    assert found == (500 if scores else 0) + moved


@pytest.mark.parametrize(
    ("gone", "score", "then"), [(995, 9.0, 1_000), (1_000, 9.0, 1_000), (4, -9.0, 0)]
)
def test_it_stays_between_nothing_and_whole(gone: int, score: float, then: int) -> None:
    assert curriculum_steps(config(5.0), played([(score,)], gone), 10_000, STEPS) == then


def test_steps_of_the_warm_up_do_not_count() -> None:
    past = played([(9.0,)], gone=0)
    assert curriculum_steps(config(5.0), past, WARM_UP, STEPS) == 0
    assert curriculum_steps(config(5.0), past, WARM_UP + 4, STEPS) == 4
