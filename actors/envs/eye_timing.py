"""Measures the eye's latency before a game: the screen turns white and black, and the eye is timed.

The latency is measured and not read from the settings. The game could not show it, because what
moves there may move by itself.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from common.settings.conditions import MAX_PICTURE_LATENCY

_SWITCHES = 6
"""Changes of the screen that are timed. A lost picture makes a change look later than it was seen,
so the soonest counts."""
_LOOKS = MAX_PICTURE_LATENCY + 2
"""Agent steps from one change to the next: the latency of the slowest eye, and one more."""

_ERRORS = 6.0
"""Standard errors by which the brightest picture is lighter than the darkest if it shows another
screen. Of so few pictures of one screen, noise lets none differ as much."""


def eye_latency(
    look: Callable[[NDArray[np.uint8]], NDArray[np.uint8]], shape: tuple[int, ...]
) -> int:
    """Returns the latency of the eye's pictures, 0 to `MAX_PICTURE_LATENCY` agent steps; 0 if it
    sees no change at all.

    The eye keeps pictures of the test, so it has to forget them before the game.

    Args:
        look: shows the eye a screen ``uint8`` of ``shape`` for one agent step and returns its
            picture.
    """
    tests = [np.full(shape, 255 * (switch % 2 == 0), np.uint8) for switch in range(_SWITCHES)]
    pictures = [look(test).astype(np.int16) for test in tests for _ in range(_LOOKS)]
    light = np.array([picture.mean() for picture in pictures])
    difference = pictures[light.argmax()] - pictures[light.argmin()]
    if difference.mean() <= _ERRORS * difference.std() / math.sqrt(difference.size):
        return 0
    bright = light > (light.min() + light.max()) / 2
    changes = np.flatnonzero(bright[1:] != bright[:-1]) + 1
    # If all pictures of a test were lost, the change after it cannot be seen either.
    seen = [each % _LOOKS for each in changes if bright[each] == (each // _LOOKS % 2 == 0)]
    # If the first picture of each is lost, the slowest eye seems slower still.
    return min(int(min(seen, default=0)), MAX_PICTURE_LATENCY)
