"""Figures of games, by hand and against an independent bootstrap."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from learner.evaluation.scores import Scores, interquartile_mean


def test_figures_by_hand() -> None:
    scores = Scores.of([21.0, -21.0, 3.0, 5.0, 7.0, 9.0, 11.0, 13.0])
    assert (scores.games, scores.mean, scores.median) == (8, 6.0, 8.0)
    assert (scores.least, scores.most) == (-21.0, 21.0)
    # (225 + 729 + 9 + 1 + 1 + 9 + 25 + 49) / 7
    assert scores.deviation == pytest.approx((1048 / 7) ** 0.5)
    assert scores.iqm == 8.0  # of 5, 7, 9 and 11
    assert scores.iqm_low < 8.0 < scores.iqm_high


def test_one_game_is_its_own_mean() -> None:
    scores = Scores.of([-3.0])
    assert (scores.mean, scores.iqm, scores.deviation) == (-3.0, -3.0, 0.0)
    assert (scores.iqm_low, scores.iqm_high) == (-3.0, -3.0)


@given(st.lists(st.integers(-21, 21), min_size=1, max_size=40))
def test_the_middle_half_is_what_is_left_without_the_quarters(found: list[int]) -> None:
    rest = sorted(found)
    for _ in range(len(found) // 4):
        rest = rest[1:-1]
    row = np.array([found], np.float64)
    assert interquartile_mean(row)[0] == pytest.approx(sum(rest) / len(rest))


def test_the_interval_is_that_of_a_bootstrap_written_out() -> None:
    found = np.random.default_rng(3).normal(10, 4, 30)
    rng = np.random.default_rng(9)
    means = []
    for _ in range(4_000):
        drawn = sorted(found[rng.integers(30)] for _ in range(30))[7:23]
        means.append(sum(drawn) / 16)
    low, high = np.percentile(means, (2.5, 97.5))
    scores = Scores.of(found.tolist())
    assert (scores.iqm_low, scores.iqm_high) == pytest.approx((low, high), abs=0.15)
