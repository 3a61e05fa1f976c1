"""The run's clock."""

from learner.run_clock import RunClock
from tests.common.test_schedule import Now


def test_a_resumed_run_has_the_seconds_of_before() -> None:
    now = Now()
    clock = RunClock(now)
    now.seconds += 3.0
    assert clock.seconds() == 3.0
    clock.restore(100.0)
    now.seconds += 2.0
    assert clock.seconds() == 102.0
