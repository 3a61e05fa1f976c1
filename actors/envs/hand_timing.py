"""Measures the hands' latency before a game: each key is pressed and released, and timed.

The latency is measured and not read from the settings. No game is running meanwhile.
"""

from collections.abc import Callable
from typing import NamedTuple

from actors.envs.key_forecast import LONGEST
from actors.robots.interface import Hands
from common.actions import Keys

_RESTS = (8, 9, 10)
"""Emulator frames in which hands come to rest on or above a key, one number for each try. The
soonest try counts, because commands may jitter."""
_PAUSE = 4
"""Emulator frames from releasing a key to pressing it again while the hand still moves: one agent
step with the usual frame skip."""


class HandLatency(NamedTuple):
    """Emulator frames from a command until its key is released or pressed.

    It is 0 if the key is so at the end of the frame that begins with the command.
    """

    release: int
    press: int
    """Latency of a press by a hand at rest."""
    press_in_play: int
    """Latency of a press by a hand that has just released a key."""


def key_latencies(
    hands: Hands, keys: Keys, give: Callable[[int], None] = lambda ago: None
) -> dict[Keys, HandLatency]:
    """Returns how soon ``hands`` release and press each of ``keys``.

    Args:
        give: called with 0 before each command, as `KeyWatch.give`.
    """
    hands.rest()
    latencies = {}
    for key in keys:
        tries = [_try(hands, key, rest, give) for rest in _RESTS]
        latency = HandLatency(*map(min, zip(*tries, strict=True)))
        # What is never pressed is never held either.
        latencies[key] = latency._replace(release=0) if latency.press == LONGEST else latency
    return latencies


def _try(hands: Hands, key: Keys, rest: int, give: Callable[[int], None]) -> HandLatency:
    """Returns how long each took in one try, in which hands come to rest for so many frames."""
    press = _until(hands, key, key, give)
    release = in_play = LONGEST
    if press < LONGEST:
        _wait(hands, rest)
        in_play = _again(hands, key, give)
        # What comes later than that would seem to answer the next command.
        _wait(hands, rest if in_play < LONGEST else LONGEST)
        release = _until(hands, Keys.NONE, key, give)
        _wait(hands, rest)
    if LONGEST in (release, press):
        hands.rest()
    return HandLatency(release, press, in_play)


def _until(hands: Hands, command: Keys, key: Keys, give: Callable[[int], None]) -> int:
    """Returns the number of frames until ``key`` is as commanded, or `LONGEST`."""
    give(0)
    hands.command(command)
    frames = 0
    while hands.step_frame() & key != command and frames < LONGEST:
        frames += 1
    return frames


def _again(hands: Hands, key: Keys, give: Callable[[int], None]) -> int:
    """Releases the held ``key`` and presses it again after a pause.

    Returns the number of frames until it is held again, or `LONGEST`.
    """
    give(0)
    hands.command(Keys.NONE)
    pause = [hands.step_frame() & key for _ in range(_PAUSE)]
    give(0)
    hands.command(key)
    released, frames = not all(pause), 0
    while not (hands.step_frame() & key and released) and frames < LONGEST:
        released = released or not hands.held & key
        frames += 1
    return frames


def _wait(hands: Hands, frames: int) -> None:
    for _ in range(frames):
        hands.step_frame()
