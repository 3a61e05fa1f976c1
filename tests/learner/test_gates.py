"""Which gates are green, red or open, by figures worked out by hand."""

from typing import Any

import pytest

from learner.gates import judge_gates
from learner.status import Gate

HEALTHY: dict[str, Any] = {
    "env": "robot",
    "valid_frame_share": 0.995,
    "pixel_deviation": 30.0,
    "max_q_deviation": 0.2,
    "squared_td_error": 0.01,
    "reward_variance": 0.04,
    "press_match_share": 0.8,
    "refused_chunks": 0,
}


def judged(**figures: Any) -> dict[str, Gate]:
    return {gate.name: gate for gate in judge_gates(**{**HEALTHY, **figures})}


def test_healthy_robot_is_all_green() -> None:
    gates = judged()
    assert [gate.passed for gate in gates.values()] == [True] * 6
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
    unknown = {name: None for name in HEALTHY if name not in ("env", "refused_chunks")}
    gates = judged(**unknown)
    assert {name for name, gate in gates.items() if gate.passed is None} == {
        "valid frames",
        "pixel deviation",
        "max-Q deviation",
        "relative TD error",
        "keys as commanded",
    }
    assert all(gate.value is None for gate in gates.values() if gate.passed is None)


def test_rewards_that_do_not_vary_say_nothing() -> None:
    gate = judged(reward_variance=0.0)["relative TD error"]
    assert (gate.value, gate.passed) == (None, None)


def test_bare_emulator_has_no_hands_to_judge() -> None:
    assert "keys as commanded" not in judged(env="ale")
