"""When failing health checks, or a standstill, end a run: on a clock that the test turns."""

from typing import Any

from common.protocol.run_status import HealthCheck
from learner.health_guard import HealthGuard

SECONDS = 300.0
CHUNK_STEPS = 64
STEPS = 10_240
"""Twice the 80 newest chunks that health checks judge."""


def check(passed: bool | None, *, name: str = "valid frames", stops: bool = True) -> HealthCheck:
    return HealthCheck(
        name=name,
        value=0.25,
        passed=passed,
        bound="≥ 0.99",
        why="the screen is not found",
        stops=stops,
    )


class Run:
    """A learner that looks once a second, while actors do a hundred steps."""

    def __init__(self, *, force: bool = False) -> None:
        self.now = 5_000.0
        self.steps = 10_000
        self.warnings: list[str] = []
        self.guard = HealthGuard(
            *(SECONDS / 60, 10.0, CHUNK_STEPS),
            force=force,
            warn=self.warnings.append,
            now=lambda: self.now,
        )

    def second(self, *checks: HealthCheck, seconds: float = 1.0, steps: int = 100) -> str | None:
        """Why the run ends in this second; None if it goes on."""
        self.now += seconds
        self.steps += steps
        return self.guard.check(checks, self.steps, 0, "look there")

    def until_ended(self, *checks: HealthCheck, patience: int = 1_000, **each: Any) -> int | None:
        """The second in which it is ended, from 0."""
        for second in range(patience):
            if self.second(*checks, **each) is not None:
                return second
        return None


def test_a_failing_check_ends_the_run_after_the_time() -> None:
    assert Run().until_ended(check(True, name="other"), check(False)) == SECONDS


def test_green_unknown_and_warning_checks_never_do() -> None:
    harmless = (check(True), check(None), check(False, stops=False))
    assert Run().until_ended(*harmless) is None


def test_one_green_look_begins_the_time_anew() -> None:
    run = Run()
    assert run.until_ended(check(False), patience=300) is None
    for passed in (True, None):
        assert run.second(check(passed)) is None
        assert run.until_ended(check(False), patience=300) is None
    assert run.second(check(False)) is not None


def test_each_check_has_its_own_time() -> None:
    run = Run()
    for name in "ab":
        assert run.until_ended(check(False, name=name), patience=300) is None
    assert run.until_ended(check(False, name="b"), check(False, name="a")) == 0


def test_without_enough_steps_time_is_not_enough() -> None:
    run = Run()
    assert run.until_ended(check(False), steps=0, patience=500) is None
    # The rest is made up by steps alone.
    assert run.until_ended(check(False), steps=40) == STEPS // 40 - 1


def test_steps_are_not_enough_without_time() -> None:
    assert Run().until_ended(check(False), steps=10_000) == SECONDS


def test_hours_of_a_suspended_process_do_not_count() -> None:
    run = Run()
    assert run.until_ended(check(False), patience=100) is None
    assert run.second(check(False), seconds=36_000.0) is None
    # Two seconds of them do, as a look may be that late on a slow machine.
    assert run.until_ended(check(False)) == SECONDS - 99 - 2 - 1


def test_time_before_the_first_red_look_does_not_count() -> None:
    run = Run()
    run.now += 10_000
    assert run.until_ended(check(False)) == SECONDS


def test_the_verdict_names_check_value_bound_and_reason() -> None:
    run = Run()
    run.until_ended(check(False), patience=300)
    assert run.second(check(False)) == (
        "health check 'valid frames' has been red for 5 minutes and 10,240 steps: it is 0.2500, "
        "not ≥ 0.99, so the screen is not found"
    )


def test_with_force_each_reason_is_warned_of_once() -> None:
    run = Run(force=True)
    assert run.until_ended(check(False, name="a"), check(False, name="b")) is None
    assert run.until_ended(check(True), steps=0) is None
    assert [warning.split(" has been")[0] for warning in run.warnings[:2]] == [
        "WARNING: health check 'a'",
        "WARNING: health check 'b'",
    ]
    (stalled,) = run.warnings[2:]
    assert stalled.startswith("WARNING: no agent step came and no update was made for 10 minutes")


def test_a_standstill_is_timed_from_the_last_step_or_update() -> None:
    run = Run()
    assert run.until_ended(steps=0) is None  # nothing ever came: actors are still to be started
    run.second()
    assert run.until_ended(steps=0, patience=599) is None
    run.second()
    assert run.until_ended(steps=0) == 599


def test_updates_alone_are_progress() -> None:
    run = Run()
    run.second()
    run.second()
    for updates in range(1_000):
        run.now += 1
        assert run.guard.check((), run.steps, updates, "look there") is None
