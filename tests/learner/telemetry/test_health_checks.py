"""Which gates are green, red or open, by figures worked out by hand."""

import math
from typing import Any

import pytest

from common.press_latency import UNMEASURED, Delay, ms_of
from common.run.config import PlayConfig
from common.run.presets import PRESETS
from learner.telemetry.health_checks import judge_gates, keys_can_follow
from learner.telemetry.status import Gate

HEALTHY: dict[str, Any] = {
    "env": "robot",
    "valid_frame_share": 0.995,
    "pixel_deviation": 30.0,
    "max_q_deviation": 0.2,
    "squared_td_error": 0.01,
    "reward_variance": 0.04,
    "press_match_share": 0.8,
    "play": PlayConfig(),
    "press": Delay(1_224, 50.0, 200 / 3, 200 / 3),
    "refused_chunks": 0,
}
KNOWN = ("env", "press", "play", "refused_chunks")


def judged(**figures: Any) -> dict[str, Gate]:
    return {gate.name: gate for gate in judge_gates(**{**HEALTHY, **figures})}


def test_healthy_robot_is_all_green() -> None:
    gates = judged()
    assert [gate.passed for gate in gates.values()] == [True] * 7
    assert gates["relative TD error"].value == pytest.approx(0.25)


def test_blind_robot_of_2017_is_red() -> None:
    gates = judged(
        valid_frame_share=0.02,
        pixel_deviation=0.0,
        max_q_deviation=0.0,
        squared_td_error=0.0412,
        reward_variance=0.04,
    )
    red = [name for name, gate in gates.items() if gate.passed is False]
    assert red == ["valid frames", "pixel deviation", "max-Q deviation", "relative TD error"]


@pytest.mark.parametrize(
    ("gate", "figures", "passed"),
    [
        ("valid frames", {"valid_frame_share": 0.99}, True),
        ("valid frames", {"valid_frame_share": 0.9899}, False),
        ("pixel deviation", {"pixel_deviation": 1.0}, False),
        ("pixel deviation", {"pixel_deviation": 1.01}, True),
        ("max-Q deviation", {"max_q_deviation": 1e-6}, False),
        ("max-Q deviation", {"max_q_deviation": 2e-6}, True),
        ("max-Q deviation", {"max_q_deviation": float("nan")}, False),
        ("relative TD error", {"squared_td_error": 0.04}, False),
        ("relative TD error", {"squared_td_error": 0.0399}, True),
        ("keys as commanded", {"press_match_share": 0.5}, True),
        ("keys as commanded", {"press_match_share": 0.49}, False),
        ("refused chunks", {"refused_chunks": 1}, False),
    ],
)
def test_bounds(gate: str, figures: dict[str, Any], passed: bool) -> None:
    assert judged(**figures)[gate].passed is passed


def test_unmeasured_gates_are_open() -> None:
    unknown = {name: None for name in HEALTHY if name not in KNOWN}
    gates = judged(press=UNMEASURED, **unknown)
    assert {name for name, gate in gates.items() if gate.passed is None} == {
        "valid frames",
        "pixel deviation",
        "max-Q deviation",
        "relative TD error",
        "keys as commanded",
        "press p99 ms",
    }
    assert all(gate.value is None for gate in gates.values() if gate.passed is None)


def test_only_gates_that_are_never_red_in_good_health_end_a_run() -> None:
    assert {name for name, gate in judged().items() if not gate.stops} == {
        "relative TD error",
        "press p99 ms",
        "refused chunks",
    }


@pytest.mark.parametrize(
    ("press", "passed"),
    [
        (Delay(100, 50.0, ms_of(8), 500.0), True),  # two decisions
        (Delay(100, 50.0, ms_of(9), 500.0), False),
        (Delay(99, 50.0, ms_of(9), 500.0), None),  # the slowest of too few
        (Delay(99, 50.0, 50.0, 50.0), None),
        (Delay(5_000, math.inf, math.inf, 500.0), False),  # broken hands
        (Delay(5_000, 50.0, math.inf, ms_of(8)), False),  # more than two decisions
        (Delay(5_000, 50.0, math.inf, ms_of(7)), None),  # nobody waited for the eighth frame
        (UNMEASURED, None),
    ],
)
def test_the_slowest_hundredth_of_presses_has_two_decisions(
    press: Delay, passed: bool | None
) -> None:
    gate = judged(press=press)["press p99 ms"]
    assert (gate.value, gate.passed, gate.bound) == (press.p99, passed, "≤ 133.3")


@pytest.mark.parametrize(
    ("play", "judges"),
    [
        (PRESETS["paper"].play, True),  # the hands are timed, not the reading of the keys
        (PRESETS["robot"].play, True),
        (PlayConfig(frame_skip=1), True),
        (PlayConfig(hand="model", press_latency=12), False),  # late on purpose
    ],
)
def test_real_hands_are_always_judged_by_their_own_time(play: PlayConfig, judges: bool) -> None:
    slow = Delay(1_000, 200.0, 250.0, 500.0)
    gate = judged(press=slow, play=play)["press p99 ms"]
    assert (gate.value, gate.passed) == (250.0, False if judges else None)


def test_keys_that_come_late_on_purpose_are_shown_but_not_judged() -> None:
    late = PlayConfig(read_keys="decision")
    gate = judged(press_match_share=0.1, play=late)["keys as commanded"]
    assert (gate.value, gate.passed) == (0.1, None)


@pytest.mark.parametrize(
    ("play", "can"),
    [
        (PlayConfig(), True),
        (PlayConfig(read_keys="decision"), False),
        (PlayConfig(frame_skip=3), False),  # an arm takes four frames at times
        (PlayConfig(hand="model", release_latency=1, press_latency=3), True),
        (PlayConfig(hand="model", release_latency=1, press_latency=4), False),  # in the fifth frame
        (PlayConfig(hand="model", command_latency=1), False),
    ],
)
def test_where_keys_can_follow_within_their_decision(play: PlayConfig, can: bool) -> None:
    assert keys_can_follow(play) is can


def test_rewards_that_do_not_vary_say_nothing() -> None:
    gate = judged(reward_variance=0.0)["relative TD error"]
    assert (gate.value, gate.passed) == (None, None)


def test_bare_emulator_has_no_hands_to_judge() -> None:
    assert not {"keys as commanded", "press p99 ms"} & set(judged(env="ale"))
