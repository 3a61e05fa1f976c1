"""Latency of the hands, found before a game: each key is pressed and released, and timed.

Nobody tells it. No game goes on meanwhile.
"""

from collections.abc import Callable

from actors.envs.key_timing import LONGEST
from actors.robots.interface import Hands
from common.actions import Keys

_RESTS = (8, 9, 10)
"""Emulator frames in which hands come to rest on or above a key, one number for each try. The
soonest try counts: commands may jitter."""


def key_latencies(
    hands: Hands, keys: Keys, give: Callable[[int], None] = lambda ago: None
) -> dict[Keys, tuple[int, int]]:
    """Returns in how many emulator frames ``hands`` release and press each of ``keys``: 0 if they
    have done so at the end of the frame that begins with the command.

    Args:
        give: is told, before each command, that it is given 0 frames ago.
    """
    hands.rest()
    latencies = {}
    for key in keys:
        tries = []
        for rest in _RESTS:
            press = _until(hands, key, key, rest, give)
            tries.append((_until(hands, Keys.NONE, key, rest, give), press))
        releases, presses = zip(*tries, strict=True)
        latencies[key] = min(releases), min(presses)
    return latencies


def _until(hands: Hands, command: Keys, key: Keys, rest: int, give: Callable[[int], None]) -> int:
    """Returns the frames in which ``key`` becomes as commanded, or `LONGEST`; the hands rest
    afterwards."""
    give(0)
    hands.command(command)
    frames = 0
    while hands.step_frame() & key != command and frames < LONGEST:
        frames += 1
    for _ in range(rest):
        hands.step_frame()
    return frames
