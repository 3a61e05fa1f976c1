"""Percentiles against sums by hand and a slow reading of their definition."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.press_latency import (
    COUNTS,
    MAX_FRAMES,
    Goal,
    KeyLatency,
    ms_of,
    place_of,
)

OUTCOMES = st.lists(st.tuples(st.booleans(), st.integers(1, MAX_FRAMES)), min_size=1, max_size=60)
"""What became of commands: reached or given up, and at which age."""


def counted(goal: Goal, outcomes: list[tuple[bool, int]]) -> list[int]:
    counts = [0] * COUNTS
    for reached, frames in outcomes:
        counts[place_of(goal, reached, frames)] += 1
    return counts


def test_each_outcome_has_a_place_of_its_own() -> None:
    goals: tuple[Goal, Goal] = ("release", "press")
    places = [
        place_of(goal, reached, frames)
        for goal in goals
        for reached in (True, False)
        for frames in range(1, MAX_FRAMES + 1)
    ]
    assert places == list(range(COUNTS))


def test_percentiles_by_hand() -> None:
    """Six commands: reached at 1, 3, 3 and 5 frames, given up at 3 and 4.

    Half of the six, three, were reached within 3 frames; 99 % of them never.
    """
    outcomes = [(True, 1), (True, 3), (True, 3), (True, 5), (False, 3), (False, 4)]
    assert KeyLatency.of(counted("press", outcomes), "press") == KeyLatency(
        measured=6, p50=ms_of(3), p99=math.inf, watched=ms_of(5), given_up=1 / 3
    )


def test_goals_are_apart() -> None:
    counts = counted("release", [(True, 2)])
    assert KeyLatency.of(counts, "release") == KeyLatency(1, ms_of(2), ms_of(2), ms_of(2), 0.0)
    assert KeyLatency.of(counts, "press") == KeyLatency()


@pytest.mark.parametrize("counts", [(), [0] * COUNTS])
def test_nothing_measured_is_not_known(counts: list[int]) -> None:
    assert KeyLatency.of(counts, "press") == KeyLatency() == KeyLatency(0, None, None, 0.0, None)


def test_a_percentile_that_too_many_gave_up_is_infinite() -> None:
    outcomes = [(True, 3)] * 98 + [(False, 4)] * 2
    found = KeyLatency.of(counted("press", outcomes), "press")
    assert found == KeyLatency(100, ms_of(3), math.inf, ms_of(4), 0.02)


@pytest.mark.parametrize(("late", "p99"), [(1, 3), (2, 9)])
def test_one_in_a_hundred_may_be_later_than_the_99th_percentile(late: int, p99: int) -> None:
    outcomes = [(True, 3)] * (100 - late) + [(True, 9)] * late
    assert KeyLatency.of(counted("release", outcomes), "release").p99 == ms_of(p99)


def test_those_given_up_are_not_taken_for_prompt() -> None:
    """Almost half of the commands live for four frames only, in which no slow hand is there."""
    slow = [(False, 4)] * 49 + [(True, 12)] * 51
    assert KeyLatency.of(counted("press", slow), "press").p50 == ms_of(12)
    never = [(False, 4)] * 50
    assert KeyLatency.of(counted("press", never), "press").p50 == math.inf


def _naive(outcomes: list[tuple[bool, int]], share: Fraction) -> int | None:
    """The first age at which at least ``share`` have reached the goal, command by command."""
    for age in range(1, MAX_FRAMES + 1):
        there = [frames for reached, frames in outcomes if reached and frames <= age]
        if Fraction(len(there), len(outcomes)) >= share:
            return age
    return None


@given(OUTCOMES)
def test_percentiles_are_those_of_the_definition(outcomes: list[tuple[bool, int]]) -> None:
    found = KeyLatency.of(counted("press", outcomes), "press")
    for ms, share in ((found.p50, Fraction(1, 2)), (found.p99, Fraction(99, 100))):
        frames = _naive(outcomes, share)
        assert ms == (math.inf if frames is None else ms_of(frames))
    assert found.measured == len(outcomes)
    assert found.given_up == sum(not reached for reached, _ in outcomes) / len(outcomes)
    assert found.watched == ms_of(max(frames for _, frames in outcomes))


@given(st.lists(st.integers(1, MAX_FRAMES), min_size=1, max_size=60))
def test_with_nothing_given_up_they_are_plain_percentiles(ages: list[int]) -> None:
    found = KeyLatency.of(counted("release", [(True, age) for age in ages]), "release")
    p50, p99 = np.percentile(ages, (50, 99), method="inverted_cdf")
    assert (found.p50, found.p99) == (ms_of(p50), ms_of(p99))


@pytest.mark.parametrize("count", [2**63 - 1, 2**70])
def test_sums_of_any_size_are_read(count: int) -> None:
    counts = [0] * COUNTS
    for reached, frames in ((True, 3), (True, 5), (False, 7)):
        counts[place_of("press", reached, frames)] = count
    read = KeyLatency.of(counts, "press")
    assert (read.measured, read.p50, read.p99) == (3 * count, ms_of(5), math.inf)
    assert read.watched == ms_of(7)
    assert read.given_up == pytest.approx(1 / 3)
