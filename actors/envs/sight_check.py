"""Checks that a camera shows the game: compares what is seen with the game's own pictures.

A camera can fail while the screen is still in its place: it may show a black game, or the same
picture for ever. Light, contrast, noise and blur do not count, because only correlations are
judged. Glare does not, because slow changes over a picture are left out.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.envs.observation import shrink

_PERIOD = 16
"""Looks from one comparison to the next, a second of the game: each costs a seventh of an agent
step."""
_AREA = 15
"""Side of the square, in pixels of a frame, whose mean is taken from its middle."""
_LEAST_DETAIL = 3.0
"""Standard deviation of the details of a game's own frame, grey levels, below which it shows
nothing that a camera might miss."""
_LEAST_CHANGE = 40.0
"""Norm of a change of the game's own frame, grey levels, that a camera must show: half of the
change when Pong's ball moves."""
_ALIKE = 0.2
"""Least correlation of details. With all of --randomise.all, a black game has at most 0.12."""
_MOVES_ALIKE = 0.1
"""Least correlation of changes. Noise alone has at most 0.05."""
_GAIN = 0.25
"""Contrast of a camera's picture, relative to the game's own, at which a change must still show
above the noise."""

Look = tuple[NDArray[np.uint8], NDArray[np.uint8]]
"""The seen frame and the game's own at one moment, ``uint8 [84, 84]``."""


@dataclass(frozen=True)
class Verdict:
    """What a comparison found."""

    shows: bool = True
    """Whether the seen frame has the details of the game's own."""
    follows: bool = True
    """Whether the seen frames changed as the game's own did; true if their changes were too small
    to tell."""


class SightCheck:
    """The check of one camera; `verdict` is that of the last comparison of this game."""

    def __init__(self) -> None:
        self.begin_game()

    def begin_game(self) -> None:
        self.verdict = Verdict()
        self._looks = 0
        self._before: Look | None = None

    def look(self, seen: NDArray[np.uint8] | None, shown: NDArray[np.uint8]) -> None:
        """Takes the frame ``uint8 [84, 84]`` that was seen, None if the screen was not, and the
        game's own picture ``uint8 [rows, columns, 3]`` that it shows."""
        self._looks += 1
        ends, begins = self._looks % _PERIOD == 0, (self._looks + 1) % _PERIOD == 0
        look = (seen, frame_of(shown)) if seen is not None and (ends or begins) else None
        if ends and look is not None and self._before is not None:
            self.verdict = compare(self._before, look)
        self._before = look if begins else None


def frame_of(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns the game's own picture ``uint8 [rows, columns, 3]`` as a frame ``uint8 [84, 84]``."""
    # The luminance of `actors.envs.phosphor` is exact to the last bit, and six times as slow.
    return shrink(np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8))


def compare(before: Look, now: Look) -> Verdict:
    """Compares one look with the next."""
    seen, own = map(_details, now)
    nothing = float(np.linalg.norm(own)) < _LEAST_DETAIL * own.size**0.5
    shows = nothing or _correlation(seen, own) > _ALIKE
    change, own_change = (
        _difference(later, earlier) for earlier, later in zip(before, now, strict=True)
    )
    size = float(np.linalg.norm(own_change))
    # With that contrast the change would have to correlate half as much again as is asked for.
    hidden = _GAIN * size < 1.5 * _MOVES_ALIKE * float(np.linalg.norm(change))
    unclear = size < _LEAST_CHANGE or hidden
    return Verdict(shows, unclear or _correlation(change, own_change) > _MOVES_ALIKE)


def _details(frame: NDArray[np.uint8]) -> NDArray[np.float32]:
    return _difference(frame, np.asarray(cv2.blur(frame, (_AREA, _AREA)), np.uint8))


def _difference(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> NDArray[np.float32]:
    return np.asarray(cv2.subtract(one, other, dtype=cv2.CV_32F), np.float32)


def _correlation(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    norms = float(np.linalg.norm(one)) * float(np.linalg.norm(other))
    return float(np.vdot(one, other)) / norms if norms else 0.0
