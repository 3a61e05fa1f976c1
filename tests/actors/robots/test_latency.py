"""The latency measurement on hands of known latency."""

import numpy as np
import pytest

from actors.envs.late_commands import LateCommands
from actors.robots.latency import FRAME_MS, Change, Latency, changes
from common.actions import KEYS_OF_ACTION, Keys
from tests.actors.robots.late_hands import LateHands


@pytest.mark.parametrize("delay", [1, 2, 4])
def test_a_known_delay_is_found_for_every_pair(delay: int) -> None:
    found = list(changes(LateHands(delay), 1, 0))
    assert len(found) == 2 * 18 * 17
    assert {(each.old, each.new, each.settled) for each in found} == {
        (a, b, settled) for a in range(18) for b in range(18) for settled in (True, False) if a != b
    }
    assert {each.frames for each in found} == {delay}
    assert not any(each.strayed for each in found)
    latency = Latency.of(found)
    assert latency.p50_ms == latency.p99_ms == pytest.approx(delay * 1000 / 60)


@pytest.mark.parametrize("delay", [30, 31])
def test_a_change_is_watched_for_half_a_second(delay: int) -> None:
    found = {each.frames for each in changes(LateHands(delay), 1, 0)}
    assert (None in found) == (delay > 30)


class Diarist(LateHands):
    """Notes each command, and for how many frames it lasts."""

    def __init__(self) -> None:
        super().__init__(1)
        self.diary: list[list[int]] = []

    def command(self, keys: Keys) -> None:
        super().command(keys)
        self.diary.append([keys, 0])

    def step_frame(self) -> Keys:
        self.diary[-1][1] += 1
        return super().step_frame()


def test_old_keys_are_held_for_long_or_come_after_others_as_in_play() -> None:
    hands = Diarist()
    orders: dict[bool, list[tuple[int, int]]] = {True: [], False: []}
    for each in changes(hands, 1, 0):
        *before, old, new = hands.diary
        assert old == [KEYS_OF_ACTION[each.old], 12 if each.settled else 4]
        assert new == [KEYS_OF_ACTION[each.new], 30]
        assert [frames for _, frames in before] == ([] if each.settled else [4, 4])
        orders[each.settled].append((each.old, each.new))
        hands.diary.clear()
    assert all(order != sorted(order) for order in orders.values())


def test_keys_that_are_only_late_do_not_stray() -> None:
    """Six frames later than commanded, those of the actions before are still to come."""
    found = list(changes(LateCommands(LateHands(1), 6, 0, np.random.default_rng(0)), 1, 0))
    assert {each.frames for each in found} == {7}
    assert not any(each.strayed for each in found)


def test_keys_that_are_never_pressed_count_as_not_reached() -> None:
    firing = [action for action, keys in enumerate(KEYS_OF_ACTION) if keys & Keys.FIRE]
    hands = LateHands(2, never=[KEYS_OF_ACTION[action] for action in firing])
    found = list(changes(hands, 1, 0))
    unreached = [each for each in found if each.frames is None]
    assert {each.new for each in unreached} == {*firing}
    assert Latency.of(found).unreached == len(unreached)


def test_hands_that_never_reach_anything_have_no_times() -> None:
    latency = Latency.of([Change(0, 1, True, None, False), Change(1, 2, False, None, True)])
    assert np.isnan([latency.p50_ms, latency.p99_ms]).all()
    assert (latency.changes, latency.unreached, latency.stray_share) == (2, 2, 0.5)


def test_a_stray_key_is_one_of_neither_command() -> None:
    found = list(changes(LateHands(2, stray=Keys.FIRE), 1, 0))
    for each in found:
        keys = KEYS_OF_ACTION[each.old] | KEYS_OF_ACTION[each.new]
        assert each.strayed == (not keys & Keys.FIRE)


def test_figures_by_hand() -> None:
    found = [Change(0, 1, True, frames, False) for frames in (1, 2, 2, 9)]
    found += [Change(1, 0, False, 3, True), Change(2, 0, False, None, True)]
    latency = Latency.of(found)
    assert latency.changes == 6
    assert latency.unreached == 1
    assert latency.stray_share == pytest.approx(2 / 6)
    # The changes took 1, 2, 2, 3 and 9 frames.
    assert latency.p50_ms == pytest.approx(2 * FRAME_MS)
    assert latency.p99_ms == pytest.approx(9 * FRAME_MS)
