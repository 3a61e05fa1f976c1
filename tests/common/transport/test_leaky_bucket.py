"""How much of what one process sends is taken."""

import pytest

from common.transport import leaky_bucket
from common.transport.leaky_bucket import NEW_NAMES_PER_SECOND, LeakyBucket
from tests.clock import Clock


@pytest.fixture
def clock() -> Clock:
    return Clock(1e6)


def test_over_time_so_much_a_second_is_admitted(clock: Clock) -> None:
    quota = LeakyBucket(64.0, clock)
    admitted = 0
    for _ in range(10_000):  # 10 s of one that sends 1,000 a second
        admitted += quota.admits("a")
        clock.now += 1 / 1024
    assert admitted == pytest.approx(64 * (10_000 / 1024 + 1), abs=2)


def test_a_second_of_it_may_come_at_once(clock: Clock) -> None:
    quota = LeakyBucket(64.0, clock)
    assert [quota.admits("a", 16.0) for _ in range(6)] == [True] * 5 + [False]
    clock.now += 0.25
    assert [quota.admits("a", 16.0) for _ in range(2)] == [True, False]


def test_what_is_more_than_a_second_of_it_comes_and_is_paid_for(clock: Clock) -> None:
    quota = LeakyBucket(64.0, clock)
    assert quota.admits("a", 640.0)
    clock.now += 8.9
    assert not quota.admits("a")
    clock.now += 0.2
    assert quota.admits("a")


def test_names_have_each_their_own(clock: Clock) -> None:
    quota = LeakyBucket(64.0, clock)
    assert quota.admits("a", 640.0)
    assert not quota.admits("a")
    assert quota.admits("b")


def test_names_that_are_invented_have_one_measure_together(clock: Clock) -> None:
    quota = LeakyBucket(1e4, clock)
    assert quota.admits("at work")
    clock.now += 1.0
    invented = 0
    for number in range(10_000):  # 10 s of one that sends 1,000 a second
        invented += quota.admits(f"invented-{number}")
        assert quota.admits("at work")
        clock.now += 1 / 1024
    assert invented == pytest.approx(NEW_NAMES_PER_SECOND * (10_000 / 1024 + 1), abs=2)


@pytest.mark.parametrize("amount", [64.0, 640.0, 6400.0])
def test_of_invented_names_less_is_admitted_than_of_two_actors_however_much_each_brings(
    clock: Clock, amount: float
) -> None:
    quota = LeakyBucket(1e4, clock)
    admitted = 0.0
    for number in range(10 * 1024):  # 10 s of one that sends 1,000 a second
        admitted += amount * quota.admits(f"invented-{number}", amount)
        clock.now += 1 / 1024
    assert 1e4 < admitted / 10 < 2e4


@pytest.mark.parametrize("amount", [64.0, 640.0, 6400.0])
def test_what_is_charged_later_counts_as_if_it_had_been_known(clock: Clock, amount: float) -> None:
    known, charged = (LeakyBucket(1e4, clock) for _ in range(2))
    for number in range(4 * 1024):  # invented names, and some at work
        name = f"name-{number if number % 4 else number % 16}"
        found = charged.admits(name)
        assert found == known.admits(name, amount)
        if found:
            charged.charge(name, amount)
        clock.now += 1 / 1024


def test_nothing_is_charged_to_a_name_that_was_not_admitted(clock: Clock) -> None:
    quota = LeakyBucket(64.0, clock)
    quota.charge("a", 640.0)
    assert not quota.knows("a")
    assert quota.admits("a", 16.0)
    quota.charge("b", 640.0)
    quota.charge("a", 1.0)  # which held less
    assert [quota.admits("a", 16.0) for _ in range(5)] == [True] * 4 + [False]


def test_a_name_in_use_keeps_its_place_and_one_that_is_silent_gives_it_up(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(leaky_bucket, "_MAX_NAMES", 2)
    quota = LeakyBucket(64.0, clock)
    assert quota.admits("silent")
    assert quota.admits("at work")
    clock.now += 30.0
    assert quota.admits("at work", 640.0)
    clock.now += 20.0
    assert not quota.admits("new")
    assert not quota.knows("new")
    clock.now += 11.0
    assert quota.admits("new")
    assert not quota.knows("silent")
    assert quota.knows("at work")
    assert len(quota._paid_until) == 2
