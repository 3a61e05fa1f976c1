"""Timing of hands before a game, against hands whose latencies are known."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from actors.envs.hand_timing import key_latencies
from actors.envs.hands import hands_of
from common.actions import Keys
from common.settings.conditions import PlayConfig
from tests.actors.envs.uneven_hands import UnevenHands

PONG = Keys.LEFT | Keys.RIGHT | Keys.FIRE


@given(st.integers(0, 36), st.integers(0, 3))
def test_each_key_has_its_latencies(latency: int, press: int) -> None:
    play = PlayConfig(actuation_latency=latency, press_latency=press)
    hands = hands_of(play, None, np.random.default_rng(0))
    found = key_latencies(hands, PONG)
    assert found == dict.fromkeys(
        (Keys.LEFT, Keys.RIGHT, Keys.FIRE), (latency, latency + press, latency + press)
    )


def test_each_key_is_timed_by_itself_and_a_stuck_one_is_given_up() -> None:
    stuck = UnevenHands({Keys.UP: (0, 2), Keys.FIRE: (0, 5), Keys.LEFT: (0, 1000)})
    found = key_latencies(stuck, Keys.UP | Keys.FIRE | Keys.LEFT)
    assert found == {Keys.UP: (0, 2, 2), Keys.FIRE: (0, 5, 5), Keys.LEFT: (0, 60, 60)}


def test_jitter_moves_the_result_by_no_more_than_itself() -> None:
    play = PlayConfig(actuation_latency=4, actuation_jitter=2)
    hands = hands_of(play, None, np.random.default_rng(0))
    for release, press, _ in key_latencies(hands, PONG).values():
        assert 4 <= release <= 6
        assert 4 <= press <= 6


class Wavering(UnevenHands):
    """Hands that press and release FIRE later in some tries than in others, and press it later
    still on the way."""

    def __init__(self) -> None:
        super().__init__({Keys.FIRE: (0, 0)})
        # Of each try: at rest, the release before the press in play, that press, the release.
        self._tries = iter((5, 0, 9, 6, 3, 0, 7, 2, 4, 0, 8, 4))

    def command(self, keys: Keys) -> None:
        super().command(keys)
        late = next(self._tries)
        self.latencies = {Keys.FIRE: (late, late)}


def test_the_soonest_try_counts() -> None:
    assert key_latencies(Wavering(), Keys.FIRE) == {Keys.FIRE: (2, 3, 7)}
