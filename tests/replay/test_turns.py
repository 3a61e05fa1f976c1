"""Turns of throttled actors; a chunk has 64 steps, and a window is four chunks."""

import pytest

from replay import turns as module
from replay.turns import Turns


@pytest.fixture
def turns() -> Turns:
    return Turns(64, 4)


def send(turns: Turns, actor: str, chunks: int, steps: int = 64) -> int:
    """Returns how many of so many chunks are taken while the limiter is closed."""
    taken = 0
    for _ in range(chunks):
        if turns.admits(actor):
            turns.charge(actor, steps, still_open=False)
            taken += 1
    return taken


def test_a_window_is_taken_of_a_throttled_actor_and_one_chunk_more_each_time_the_limiter_opens(
    turns: Turns,
) -> None:
    turns.has_turn("waits")
    assert send(turns, "flooder", 10) == 4
    for _ in range(3):
        turns.open()
        assert turns.has_turn("waits")
        send(turns, "waits", 1)
        assert send(turns, "flooder", 10) == 1


def test_who_waits_and_sends_one_chunk_has_as_many_steps_as_who_sends_without_end(
    turns: Turns,
) -> None:
    taken = {"flooder": 0, "honest": 0}
    turns.has_turn("honest")
    for _ in range(100):
        turns.open()
        turns.charge("flooder", 64, still_open=False)  # it is always there first
        taken["flooder"] += 1 + send(turns, "flooder", 10)
        if turns.has_turn("honest"):
            taken["honest"] += send(turns, "honest", 1)
            assert not turns.has_turn("honest")
    assert taken == {"flooder": 100 + 3, "honest": 100}


def test_who_brings_four_chunks_in_its_turn_waits_for_the_others_four(turns: Turns) -> None:
    send(turns, "one", 1)
    send(turns, "four", 4)
    has_turn = []
    for _ in range(4):
        turns.open()
        has_turn.append((turns.has_turn("one"), turns.has_turn("four")))
        send(turns, "one", 1)
    assert has_turn == [(True, False)] * 3 + [(True, True)]


def test_when_nobody_else_asks_an_actor_is_free_of_what_it_was_ahead(turns: Turns) -> None:
    turns.has_turn("former")
    assert send(turns, "alone", 4) == 4
    turns.open()  # "former" asked
    assert not turns.has_turn("alone")
    turns.open()
    assert turns.has_turn("alone")
    assert send(turns, "alone", 5) == 4


def test_a_long_chunk_is_paid_for(turns: Turns) -> None:
    turns.has_turn("waits")
    assert send(turns, "flooder", 2, steps=640) == 1
    opened = 0
    while not turns.admits("flooder"):
        turns.open()
        turns.has_turn("waits")
        opened += 1
    assert opened == 7  # 640 - 7 * 64 < 4 * 64


def test_what_comes_while_the_limiter_stays_open_counts_a_window_at_most(turns: Turns) -> None:
    turns.has_turn("waits")
    for _ in range(1_000):
        turns.charge("fast", 64, still_open=True)
    assert not turns.admits("fast")
    turns.open()
    assert turns.admits("fast")


def test_what_comes_while_the_limiter_stays_open_pays_nothing_back(turns: Turns) -> None:
    turns.charge("long", 640, still_open=False)
    turns.charge("long", 64, still_open=True)
    for _ in range(6):
        turns.open()
    assert not turns.admits("long")  # 640 - 6 * 64 = 4 * 64
    turns.open()
    assert turns.admits("long")


def test_a_new_actor_waits_for_the_next_opening(turns: Turns) -> None:
    assert not turns.has_turn("new")
    turns.open()
    assert turns.has_turn("new")
    assert turns.has_turn("new")  # until it sends


def test_who_is_told_to_go_on_may_send_one_chunk_however_far_it_is_ahead(turns: Turns) -> None:
    assert send(turns, "ahead", 9) == 4
    turns.let_go("ahead")
    assert turns.admits("ahead")
    assert turns.admits("ahead")  # until one is taken
    assert send(turns, "ahead", 9) == 1


def test_who_sends_on_and_on_is_told_from_who_was_refused_now_and_then(turns: Turns) -> None:
    assert send(turns, "a", 4 + module.INSISTENCE - 1) == 4
    assert not turns.ignores_throttle("a")
    turns.has_turn("waits")
    turns.open()
    assert send(turns, "a", 1 + module.INSISTENCE - 1) == 1
    assert not turns.ignores_throttle("a")
    assert not turns.admits("a")
    assert turns.ignores_throttle("a")
    assert not turns.ignores_throttle("b")


def test_the_accounts_are_bounded(turns: Turns, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_ACTORS", 2)
    for name in "abc":
        send(turns, name, 1)
        turns.has_turn(f"{name} polls")
        turns.let_go(f"{name} goes on")
        send(turns, name, 5)
    assert len(turns._paid_until) <= 2
    assert turns._asked | turns._let_go | set(turns._refused) <= set(turns._paid_until)
    turns.open()
