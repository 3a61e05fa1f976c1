"""The check that a camera shows the game, on pictures whose faults are made by hand."""

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.envs import sight_check
from actors.envs.sight_check import SightCheck, Verdict, compare, frame_of

Frame = NDArray[np.uint8]
SEEN_AND_FOLLOWED = Verdict(shows=True, follows=True)


def game(ball: int) -> Frame:
    """A frame like Pong's, with a ball of four pixels in column ``ball``."""
    frame = np.full((84, 84), 87, np.uint8)
    frame[5:8] = frame[78:81] = 236  # walls
    frame[30:38, 10], frame[40:48, 73] = 130, 147  # paddles
    frame[50:52, ball : ball + 2] = 236
    return frame


def glare(share: float) -> NDArray[np.float64]:
    rows, columns = np.mgrid[:84, :84]
    spot = np.exp(-((rows - 30) ** 2 + (columns - 50) ** 2) / 800)
    return np.asarray(255 * share * spot, np.float64)


def camera(frame: Frame, noise: float = 0.0, share: float = 0.0, gain: float = 1.0) -> Frame:
    """``frame`` with light and noise, which is another in each call."""
    light = gain * frame + (1 - frame / 255) * glare(share)
    seen = light + noise * _RNG.standard_normal(frame.shape)
    return np.asarray(seen.round().clip(0, 255), np.uint8)


_RNG = np.random.default_rng(7)
FAULTS = [
    {},
    {"share": 0.4},
    {"noise": 5.0},
    {"gain": 0.3},
    {"noise": 3.0, "share": 0.4, "gain": 0.7},
]


def verdict(seen: Sequence[Frame], own: Sequence[Frame]) -> Verdict:
    before, now = zip(seen, own, strict=True)
    return compare(before, now)


@pytest.mark.parametrize("faults", FAULTS)
def test_a_game_is_seen_through_noise_glare_and_in_poor_light(faults: dict[str, float]) -> None:
    for ball in range(20, 60):
        own = game(ball), game(ball + 3)
        assert verdict([camera(each, **faults) for each in own], own) == SEEN_AND_FOLLOWED


@pytest.mark.parametrize("faults", FAULTS)
@pytest.mark.parametrize("level", [0, 60])
def test_a_game_of_one_grey_is_not_seen(level: int, faults: dict[str, float]) -> None:
    nothing = np.full((84, 84), level, np.uint8)
    for ball in range(20, 60):
        seen = camera(nothing, **faults), camera(nothing, **faults)
        assert verdict(seen, (game(ball), game(ball + 3))) == Verdict(False, False)


@pytest.mark.parametrize("faults", FAULTS)
def test_a_game_that_stands_still_before_the_camera_is_not_followed(
    faults: dict[str, float],
) -> None:
    for ball in range(20, 60):
        seen = camera(game(40), **faults), camera(game(40), **faults)
        assert verdict(seen, (game(ball), game(ball + 3))) == Verdict(True, False)


def test_what_does_not_move_or_shows_nothing_is_no_fault() -> None:
    own = game(30), game(30)
    assert verdict([camera(each, noise=5.0) for each in own], own) == SEEN_AND_FOLLOWED
    black = np.zeros((84, 84), np.uint8)  # as some games while they think
    assert verdict([camera(black, noise=5.0)] * 2, [black] * 2) == SEEN_AND_FOLLOWED


def test_a_change_within_the_noise_tells_nothing() -> None:
    faint = game(30)
    faint[60, 60] += 50
    still = [camera(game(30), noise=5.0) for _ in range(2)]
    assert verdict(still, (game(30), faint)).follows
    assert not verdict([game(30)] * 2, (game(30), faint)).follows  # without noise it would show


def rgb(frame: Frame) -> Frame:
    return np.repeat(np.kron(frame, np.ones((2, 2), np.uint8))[..., None], 3, axis=2)


def test_frames_are_compared_by_pairs_of_the_newest_looks() -> None:
    assert (frame_of(rgb(game(30))) == game(30)).all()
    check = SightCheck()
    period = sight_check._PERIOD

    def look(number: int, seen: int | None) -> Verdict:
        check.look(None if seen is None else game(seen), rgb(game(number)))
        return check.verdict

    for number in range(1, 2 * period):
        assert look(number, number) == SEEN_AND_FOLLOWED
    stuck = Verdict(shows=True, follows=False)
    assert look(2 * period, 2 * period - 1) == stuck
    for number in range(2 * period + 1, 3 * period):
        assert look(number, number) == stuck  # until it is compared again
    assert look(3 * period, 3 * period) == SEEN_AND_FOLLOWED
    check.begin_game()
    for number in range(1, period):
        look(number, None)
    assert look(period, period - 1) == SEEN_AND_FOLLOWED  # the look before saw no screen
    look(period + 1, period)
    for number in range(period + 2, 2 * period):
        look(number, number)
    assert look(2 * period, 2 * period - 1) == stuck
    check.begin_game()
    assert check.verdict == SEEN_AND_FOLLOWED
    assert look(period, 1) == SEEN_AND_FOLLOWED  # the first look of a game
