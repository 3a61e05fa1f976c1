"""Latency of the eye, found before a game: the screen turns white and black, and the eye is timed.

Nobody tells it, and the game does not: what moves in it may move by itself.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from common.run.conditions import MAX_PICTURE_LATENCY

_SWITCHES = 6
"""Changes of the screen that are timed. A picture that is lost makes one of them look later than
it was seen, so the soonest counts."""
_LOOKS = MAX_PICTURE_LATENCY + 2
"""Agent steps from a change to the next one: those of the latest eye, and one more."""


def eye_latency(
    look: Callable[[NDArray[np.uint8]], NDArray[np.uint8]], screen: NDArray[np.uint8]
) -> int:
    """Returns the agent steps by which the eye's pictures are late; 0 if it sees no change at all.

    Args:
        look: shows the eye a screen for one agent step; returns its picture then.
        screen: what it sees at last, for as long as it needs to forget the test.
    """
    tests = [np.full_like(screen, 255 * (switch % 2 == 0)) for switch in range(_SWITCHES)]
    light = np.array([[look(test).mean() for _ in range(_LOOKS)] for test in tests])
    for _ in range(_LOOKS):
        look(screen)
    bright = (light > (light.min() + light.max()) / 2).ravel()
    changes = np.flatnonzero(bright[1:] != bright[:-1]) + 1
    # Where a whole test was lost, the change after it is not to be seen either.
    seen = [each % _LOOKS for each in changes if bright[each] == (each // _LOOKS % 2 == 0)]
    return int(min(seen, default=0))
