"""Figures for people, written by hand."""

import math

import pytest

from common.protocol.run_status import HealthCheck
from learner.telemetry import formats, panels


def check(value: float | None, bound: str) -> HealthCheck:
    return HealthCheck("press", value, bound, passed=False, why="slow")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (formats.written("count", 1_234_567), "1,234,567"),
        (formats.decimal(-20.094, 2), "−20.09"),
        (formats.written(".2", None), "–"),
        (formats.decimal(float("nan"), 2), "nan"),
        (formats.significant(0.000829), "0.0008290"),
        (formats.significant(12.4), "12.40"),
        (panels.finishing_note({"evaluation/steps_left": 0}), "finishing"),
        (
            panels.finishing_note({"evaluation/steps_left": 12_000, "run/seconds_left": 20.0}),
            "12,000 test steps, 00:20 left",
        ),
        (panels.finishing_note({"evaluation/steps_left": 9}), "9 test steps"),
        (
            formats.scores({"play/test_reward": -19.0, "play/test_epoch": 2}),
            "score: training –, test −19.00 (epoch 2), best test –, random –",
        ),
        (formats.reading_and_bound(check(90.0, "≤ 66")), "90.00, not ≤ 66"),
        (formats.reading_and_bound(check(1_234.0, "= 0")), "1,234, not 0"),
        (formats.reading_and_bound(check(math.nan, "= 0")), "nan, not 0"),
        (formats.reading_and_bound(check(0.4, "= 0")), "0.4000, not 0"),
        (formats.reading(check(None, "= 0")), "–"),
        (formats.significant(-0.5), "−0.5000"),
        (formats.significant(123_456.7), "123,457"),
        (formats.significant(2_345_678.0), "2.3e+06"),
        (formats.significant(4.1e-7), "4.1e-07"),
        (formats.significant(0.0), "0"),
        (formats.share(999_999, 1_000_000), "99 %"),
        (formats.share(1_020, 1_000), "100 %"),
        (formats.share(3, 0), "0 %"),
        (formats.per_cent(0.987), "99 %"),
        (formats.per_cent(0.9864, 2), "98.64 %"),
        (formats.duration(59.9), "00:59"),
        (formats.duration(11_565), "3:12:45"),
        (formats.duration(187_654), "2 d 04:07"),
        (formats.written("duration", None), "–"),
        (formats.written("ms", None), "–"),
        (formats.written("ms", 50 / 3), "17"),
        (formats.written("ms", math.inf), "∞"),
    ],
)
def test_figures_for_people(text: str, expected: str) -> None:
    assert text == expected


@pytest.mark.parametrize(
    ("number", "expected"),
    [
        (999, "999"),
        (1_000, "1.0k"),
        (9_949, "9.9k"),
        (9_999, "10k"),
        (12_345, "12k"),
        (999_499, "999k"),
        (999_500, "1.0M"),
        (9_960_000, "10M"),
        (999_499_999, "999M"),
        (10**9, "1.0G"),
        (998 * 10**9, "998G"),
    ],
)
def test_troubles_have_at_most_four_characters(number: int, expected: str) -> None:
    assert panels.troubles({"actors/missed_deadlines": number}) == f", {expected} late"
