"""How long hands take from a command to its keys, as counts that add up over processes.

A command has two goals: *release*, no key is pressed any more that it does not ask for; and
*press*, all that it asks for are. Each is measured where it was not reached when the command came,
in whole emulator frames of game time, because that is how often the controller is read. A goal
that was not reached before another command, or within `MOST_FRAMES`, is *given up* at that age:
it took longer, nobody knows how much. To leave such ones out would flatter slow hands, so the
percentiles come from the product-limit estimator, which takes them for what they are (Kaplan and
Meier 1958, "Nonparametric estimation from incomplete observations").
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

MOST_FRAMES = 30
"""Frames for which a command is watched at most: half a second."""
COUNTS = 2 * 2 * MOST_FRAMES
"""Of a goal's outcome at an age: ``[release or press, reached or given up, age - 1]``, flat."""

Goal = Literal["release", "press"]

_ROUNDING = 1e-9


def place_of(goal: Goal, reached: bool, frames: int) -> int:
    """Where among the counts this outcome is counted, ``frames`` (1 or more) after the command."""
    return ((goal == "press") * 2 + (not reached)) * MOST_FRAMES + frames - 1


def ms_of(frames: int) -> float:
    """Milliseconds of game time."""
    return frames * 1000 / 60


@dataclass(frozen=True)
class Delay:
    """How long the hands took to reach one goal, in ms of game time.

    A percentile is None if nothing was measured, and infinite if too few commands had reached the
    goal by the age ``watched``: then it is longer than that.
    """

    measured: int = 0
    """Commands, those that were given up included."""
    p50: float | None = None
    p99: float | None = None
    watched: float = 0.0
    """Greatest age at which a command was reached or given up."""

    @classmethod
    def of(cls, counts: Sequence[int], goal: Goal) -> "Delay":
        """Sum up ``counts``, `COUNTS` of them or none."""
        if not any(counts):
            return UNMEASURED
        outcomes = np.array(counts, np.float64).reshape(2, 2, MOST_FRAMES)
        reached, given_up = outcomes[int(goal == "press")]
        ages = np.flatnonzero(reached + given_up) + 1
        if not ages.size:
            return UNMEASURED
        waiting = still_waiting(reached, given_up)
        return cls(
            measured=int((reached + given_up).sum()),
            p50=_percentile(waiting, 0.5),
            p99=_percentile(waiting, 0.99),
            watched=ms_of(int(ages[-1])),
        )


UNMEASURED = Delay()


def still_waiting(
    reached: NDArray[np.float64], given_up: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Share of the commands that take more than 1, 2, … frames, ``[frames]``.

    Kaplan and Meier's estimate: the product of (1 − reached at an age / watched up to that age).
    What is given up at an age was watched in that frame.
    """
    watched = np.cumsum((reached + given_up)[::-1])[::-1]
    return np.asarray(np.cumprod(1 - reached / np.maximum(watched, 1)), np.float64)


def _percentile(waiting: NDArray[np.float64], share: float) -> float:
    """ms after which at least ``share`` have reached the goal."""
    enough = np.flatnonzero(waiting <= 1 - share + _ROUNDING)
    return ms_of(int(enough[0]) + 1) if enough.size else math.inf
