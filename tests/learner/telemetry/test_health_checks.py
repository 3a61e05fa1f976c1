"""Which health checks are green, red or open, by figures worked out by hand."""

import math
from dataclasses import asdict, replace

import pytest

from common.metrics import METRICS, Bound, Metric, Value, declare
from common.press_latency import KeyLatency, ms_of
from common.protocol.run_status import HealthCheck
from common.settings.conditions import PlayConfig
from common.settings.presets import PRESETS
from common.settings.ranges import RandomiseConfig
from learner.telemetry.health_checks import judge, reasons

HEALTHY: dict[str, Value] = {
    "play/valid_frame_share": 0.995,
    "play/following_frame_share": 0.99,
    "learning/pixel_deviation": 30.0,
    "learning/held_out_std": 0.2,
    "learning/recent_max_q_std": 0.2,
    "learning/relative_td_error": 0.25,
    "play/press_match_share": 0.8,
    "hands/press_measured": 1_224,
    "hands/press_p99": 200 / 3,
    "hands/press_watched": 200 / 3,
    "stream/chunks_refused": 0,
    "stream/chunks_excess": 0,
}


def judged(
    values: dict[str, Value] | None = None, play: PlayConfig | None = None, env: str = "robot"
) -> dict[str, HealthCheck]:
    config = replace(PRESETS["robot"], env=env, play=play or PlayConfig())
    return {check.name: check for check in judge({**HEALTHY, **(values or {})}, config)}


def test_healthy_robot_is_all_green() -> None:
    checks = judged()
    assert [check.passed for check in checks.values()] == [True] * 7


def test_keys_that_may_be_drawn_too_late_for_their_step_are_not_judged() -> None:
    values: dict[str, Value] = {**HEALTHY, "play/press_match_share": 0.1}
    for most, judged_then in ((1, False), (2, None)):
        config = replace(
            PRESETS["robot"],
            play=PlayConfig(hand="model", press_latency=2),
            randomise=RandomiseConfig(press_latency=most),
        )
        checks = {check.name: check for check in judge(values, config)}
        assert checks["keys as commanded"].passed is judged_then


@pytest.mark.parametrize(
    "ranges",
    [
        RandomiseConfig(actuation_latency=1),
        RandomiseConfig(actuation_jitter=1),
        RandomiseConfig(noise=8.0),
    ],
)
def test_hands_whose_latency_is_drawn_are_not_judged(ranges: RandomiseConfig) -> None:
    slow: dict[str, Value] = {"hands/press_p99": 250.0, "play/press_match_share": 0.1}
    config = replace(PRESETS["robot"], randomise=ranges)
    checks = {check.name: check.passed for check in judge({**HEALTHY, **slow}, config)}
    passed = False if ranges.noise else None
    assert (checks["press p99 ms"], checks["keys as commanded"]) == (passed, passed)


def test_a_camera_that_froze_is_red() -> None:
    frozen: dict[str, Value] = {
        "play/following_frame_share": 0.01,
        "learning/recent_max_q_std": 0.0,
    }
    checks = judged(frozen).values()
    red = [check.name for check in checks if check.passed is False and check.stops]
    assert red == ["following frames", "recent max-Q deviation"]


def test_blind_robot_of_2017_is_red() -> None:
    blind: dict[str, Value] = {
        "play/valid_frame_share": 0.02,
        "learning/pixel_deviation": 0.0,
        "learning/held_out_std": 0.0,
        "learning/relative_td_error": 1.03,
    }
    red = [name for name, check in judged(blind).items() if check.passed is False]
    assert red == ["valid frames", "pixel deviation", "max-Q deviation", "relative TD error"]


@pytest.mark.parametrize(
    ("name", "key", "value", "passed"),
    [
        ("valid frames", "play/valid_frame_share", 0.99, True),
        ("valid frames", "play/valid_frame_share", 0.9899, False),
        ("pixel deviation", "learning/pixel_deviation", 1.0, False),
        ("pixel deviation", "learning/pixel_deviation", 1.01, True),
        ("max-Q deviation", "learning/held_out_std", 1e-6, False),
        ("max-Q deviation", "learning/held_out_std", 2e-6, True),
        ("max-Q deviation", "learning/held_out_std", float("nan"), False),
        ("relative TD error", "learning/relative_td_error", 1.0, False),
        ("relative TD error", "learning/relative_td_error", 0.9999, True),
        ("keys as commanded", "play/press_match_share", 0.5, True),
        ("keys as commanded", "play/press_match_share", 0.49, False),
        ("refused chunks", "stream/chunks_refused", 1, False),
        ("excess chunks", "stream/chunks_excess", 1, False),
        ("following frames", "play/following_frame_share", 0.49, False),
        ("recent max-Q deviation", "learning/recent_max_q_std", 1e-6, False),
    ],
)
def test_bounds(name: str, key: str, value: float, passed: bool) -> None:
    assert judged({key: value})[name].passed is passed


def test_a_figure_that_is_always_right_is_not_listed_until_it_is_wrong() -> None:
    admitted: dict[str, Value] = {
        "play/following_frame_share": 0.5,
        "learning/recent_max_q_std": 2e-6,
    }
    quiet = {"excess chunks", "following frames", "recent max-Q deviation"}
    assert not quiet & judged(admitted).keys()
    assert not judged({"stream/chunks_excess": 3})["excess chunks"].stops


def test_unmeasured_checks_are_open() -> None:
    known = {"stream/chunks_refused", "stream/chunks_excess"}
    checks = judged({key: None for key in HEALTHY if key not in known})
    assert {name for name, check in checks.items() if check.passed is None} == {
        "valid frames",
        "pixel deviation",
        "max-Q deviation",
        "relative TD error",
        "keys as commanded",
        "press p99 ms",
    }
    assert all(check.value is None for check in checks.values() if check.passed is None)


def test_a_learner_is_unhealthy_by_red_checks_that_end_runs() -> None:
    values: dict[str, Value] = {
        "play/valid_frame_share": None,
        "learning/pixel_deviation": 0.5,
        "learning/relative_td_error": 1.5,
    }
    told = reasons(0.0, judged(values).values())
    assert told == ["health check 'pixel deviation' is red: frames are black or of one grey"]


def test_only_checks_that_are_never_red_in_good_health_end_a_run() -> None:
    assert {name for name, check in judged().items() if not check.stops} == {
        "relative TD error",
        "press p99 ms",
        "refused chunks",
    }


def told(press: KeyLatency) -> dict[str, Value]:
    return {f"hands/press_{name}": value for name, value in asdict(press).items()}


@pytest.mark.parametrize(
    ("press", "passed"),
    [
        (KeyLatency(100, 50.0, ms_of(8), 500.0), True),  # two decisions
        (KeyLatency(100, 50.0, ms_of(9), 500.0), False),
        (KeyLatency(99, 50.0, ms_of(9), 500.0), None),  # the slowest of too few
        (KeyLatency(99, 50.0, 50.0, 50.0), None),
        (KeyLatency(5_000, math.inf, math.inf, 500.0), False),  # broken hands
        (KeyLatency(5_000, 50.0, math.inf, ms_of(8)), False),  # more than two decisions
        (KeyLatency(5_000, 50.0, math.inf, ms_of(7)), None),  # nobody waited for the eighth frame
        (KeyLatency(), None),
    ],
)
def test_the_slowest_hundredth_of_presses_has_two_agent_steps(
    press: KeyLatency, passed: bool | None
) -> None:
    check = judged(told(press))["press p99 ms"]
    assert (check.value, check.passed, check.bound) == (press.p99, passed, "≤ 133.3")


@pytest.mark.parametrize(
    ("play", "judges"),
    [
        (PRESETS["paper"].play, True),  # the hands are timed, not the reading of the keys
        (PRESETS["robot"].play, True),
        (PlayConfig(frame_skip=1), True),
        (PlayConfig(hand="model", press_latency=12), False),  # late on purpose
        (PlayConfig(actuation_latency=12), False),
        (PlayConfig(actuation_jitter=12), False),
        (PlayConfig(equal_latency=12), False),
        (PlayConfig(robot="hand.npz"), False),  # late by nature
    ],
)
def test_real_hands_are_always_judged_by_their_own_time(play: PlayConfig, judges: bool) -> None:
    slow = KeyLatency(1_000, 200.0, 250.0, 500.0)
    check = judged(told(slow), play)["press p99 ms"]
    assert (check.value, check.passed) == (250.0, False if judges else None)


def test_keys_that_come_late_on_purpose_are_shown_but_not_judged() -> None:
    late = PlayConfig(read_keys="decision")
    check = judged({"play/press_match_share": 0.1}, late)["keys as commanded"]
    assert (check.value, check.passed) == (0.1, None)


def test_a_figure_from_outside_is_judged_by_its_bound() -> None:
    bound = Bound("room temperature", "<", 40.0, "the motors are about to fail", stops=False)
    declare(Metric("room/celsius", "none", ".1", "Temperature of the room", bound=bound))
    try:
        check = judged({"room/celsius": 41.0})["room temperature"]
    finally:
        del METRICS["room/celsius"]
    assert (check.passed, check.bound, check.stops) == (False, "< 40", False)
    assert check.why == "the motors are about to fail"


def test_bare_emulator_has_no_hands_to_judge() -> None:
    assert not {"keys as commanded", "press p99 ms"} & set(judged(env="ale"))
