"""The counters, on a clock that the test turns."""

import socket
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from actors import counters as tally
from actors.counters import WINDOW, ActorCounters
from actors.envs.step_info import StepInfo
from actors.loop import Step

STATE = np.zeros((4, 84, 84), np.uint8)


def step(*, valid: bool = True, match: bool = True, **info: Any) -> Step:
    told = StepInfo(False, 0.0, 1, keys_match=match, **info)
    return Step(0, False, STATE, valid, 0, False, 0.0, False, False, STATE, told)


class Clock:
    def __init__(self) -> None:
        self.now = 100.0
        self.worked = 7.0

    def monotonic(self) -> float:
        return self.now

    def process_time(self) -> float:
        return self.worked


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(tally, "time", clock)
    return clock


def test_before_the_first_step_there_is_nothing(clock: Clock) -> None:
    found = ActorCounters()
    assert (found.stats.steps, found.stats.valid_share, found.stats.match_share) == (0, 0.0, 0.0)
    clock.now += 1
    assert found.rates() == (0.0, 0.0, 0.0)


def test_shares_are_over_all_steps() -> None:
    found = ActorCounters()
    for valid, match in ((True, True), (False, True), (True, False), (False, True)):
        found.count(step(valid=valid, match=match))
    assert (found.stats.steps, found.stats.valid_share, found.stats.match_share) == (4, 0.5, 0.75)


def test_what_the_clock_tells_is_added_up() -> None:
    found = ActorCounters()
    found.count(step())  # an emulator, which tells nothing
    found.count(step(elapsed=5, missed_deadlines=3, late_frames=7, gave_up=False))
    found.count(step(elapsed=8, missed_deadlines=0, late_frames=1, gave_up=True))
    found.count(step(elapsed=1, missed_deadlines=0, late_frames=0, gave_up=False))
    stats = found.stats
    assert (stats.steps, stats.decisions) == (4, 15)
    assert (stats.missed_deadlines, stats.late_frames, stats.waits_given_up) == (3, 8, 1)


def test_what_the_hands_took_is_counted_by_its_place() -> None:
    found = ActorCounters()
    found.count(step())
    assert not any(found.key_times)
    for places in ((), (2, 61), (2,)):
        found.count(step(key_times=places))
    assert {place: n for place, n in enumerate(found.key_times) if n} == {2: 2, 61: 1}
    policy = SimpleNamespace(epsilon=0.5, weights_version=3)
    told = found.told(policy, False, made=5)  # type: ignore[arg-type]
    assert told.key_times == tuple(found.key_times)
    assert (told.epsilon, told.weights_version, told.made, told.steps) == (0.5, 3, 5, 4)


def test_what_the_process_takes_of_its_machine_is_told(clock: Clock) -> None:
    found = ActorCounters("a")
    policy = SimpleNamespace(epsilon=0.5, weights_version=3)
    clock.now, clock.worked = 102.0, 10.0
    first = found.told(policy, False)  # type: ignore[arg-type]
    clock.now, clock.worked = 106.0, 11.5
    second = found.told(policy, False)  # type: ignore[arg-type]
    assert (first.seconds, first.busy_cores) == (2.0, 1.5)
    assert (second.seconds, second.busy_cores) == (6.0, 0.75)
    assert second.memory_bytes > 10_000_000
    assert second.machine == socket.gethostname()


def test_rates_are_of_late(clock: Clock) -> None:
    found = ActorCounters()
    for _ in range(30):
        found.count(step())
    found.throttled_seconds += 0.5
    clock.now += 2.0
    clock.worked += 1.0
    assert found.rates() == (15.0, 0.25, 0.5)
    for _ in range(3):
        found.count(step())
    clock.now += 1.0
    assert found.rates() == (11.0, 0.5 / 3, 1.0 / 3)
    clock.now += WINDOW - 1.0  # the first two seconds are long ago
    assert found.rates() == (0.3, 0.0, 0.0)


def test_an_actor_that_is_held_for_a_second_still_plays(clock: Clock) -> None:
    found = ActorCounters()
    rates, busy = [], []
    for second in range(20):
        clock.now += 1.0
        if not second % 2:
            clock.worked += 0.5
            for _ in range(30):
                found.count(step())
        rate, _, cores = found.rates()
        rates.append(rate)
        busy.append(cores)
    assert min(rates) >= 15.0
    assert min(busy) >= 0.25


def test_a_pause_that_began_before_the_last_look_fills_the_time_at_most(clock: Clock) -> None:
    found = ActorCounters()
    clock.now += 1.0
    found.throttled_seconds += 5.0
    assert found.rates() == (0.0, 1.0, 0.0)


def test_two_looks_at_the_same_moment_do_not_divide_by_zero(clock: Clock) -> None:
    found = ActorCounters()
    found.rates()
    assert found.rates() == (0.0, 0.0, 0.0)
