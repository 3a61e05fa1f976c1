"""How time passes: what is refused, and how it is told."""

import pytest

from common.errors import InputError
from common.settings.clock import ClockConfig

REAL_TIME = ClockConfig(sync=False, speed=2.5)


@pytest.mark.parametrize("speed", [-1.0, 0.0, float("inf"), float("nan")])
def test_a_speed_at_which_no_time_could_pass_is_refused(speed: float) -> None:
    with pytest.raises(InputError, match=f"--speed is {speed}: choose a finite number above 0"):
        ClockConfig(sync=False, speed=speed).check()
    REAL_TIME.check("robot")


@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_a_world_that_waits_has_no_speed(speed: float) -> None:
    with pytest.raises(InputError, match="--speed is for --no-sync"):
        ClockConfig(speed=speed).check()


@pytest.mark.parametrize(
    ("clock", "told"),
    [
        (ClockConfig(), ""),
        (ClockConfig(wait_action=True), ", waiting for its keys"),
        (REAL_TIME, ", in real time × 2.5"),
        (ClockConfig(sync=False, wait_action=True), ", in real time × 1, waiting for its keys"),
    ],
)
def test_what_is_unusual_is_told_behind_what_is_played(clock: ClockConfig, told: str) -> None:
    assert str(clock) == told
