"""Latency of the hands, from a command to its keys, as counts that add up over processes.

A command has two goals: *release*, every key that it does not ask for is up; and *press*, every
key that it asks for is down. Each goal is measured unless the command finds it reached. The unit
is the emulator frame of game time, because that is how often the controller is read. A goal that
is not reached before the next command, or within `MAX_FRAMES`, is *given up* at that age.

Percentiles are over all measured commands. A command that was given up counts as slower than every
other, because leaving it out would flatter slow hands. A percentile is infinite if too many
commands were given up. Arms that work give up none (0 of 3,670 in random play of Pong and
Breakout).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from common.settings.conditions import FRAMES_PER_SECOND

MAX_FRAMES = 30
"""Maximum number of frames for which a command is watched: half a second."""
COUNTS = 2 * 2 * MAX_FRAMES
"""Number of counts: outcomes by age, ``[release or press, reached or given up, age - 1]``, flat."""

Goal = Literal["release", "press"]


def place_of(goal: Goal, reached: bool, frames: int) -> int:
    """Returns the index in the counts of an outcome ``frames`` (1 or more) after the command."""
    return ((goal == "press") * 2 + (not reached)) * MAX_FRAMES + frames - 1


def ms_of(frames: int) -> float:
    """Returns the milliseconds of game time that so many emulator frames take."""
    return frames * 1000 / FRAMES_PER_SECOND


@dataclass(frozen=True)
class KeyLatency:
    """How long the hands took to reach one goal, in ms of game time."""

    measured: int = 0
    """Number of commands, including those that were given up."""
    p50: float | None = None
    """Time within which half of the commands reached the goal; None if nothing was measured,
    infinite if more than half were given up."""
    p99: float | None = None
    watched: float = 0.0
    """Greatest age at which a command was reached or given up."""
    given_up: float | None = None
    """Share of the commands that were given up."""

    @classmethod
    def of(cls, counts: Sequence[int], goal: Goal) -> "KeyLatency":
        """Returns the latency that ``counts`` describe; there are `COUNTS` of them, or none."""
        # Python's integers, because the sums of reported counts may not fit numpy's.
        outcomes = np.array(counts or [0] * COUNTS, object).reshape(2, 2, MAX_FRAMES)
        reached, given_up = outcomes[int(goal == "press")]
        measured = int((reached + given_up).sum())
        if not measured:
            return cls()
        return cls(
            measured=measured,
            p50=_percentile(reached, measured, 50),
            p99=_percentile(reached, measured, 99),
            watched=ms_of(int(np.flatnonzero(reached + given_up)[-1]) + 1),
            given_up=int(given_up.sum()) / measured,
        )


def reached_by_age(counts: Sequence[int], goal: Goal) -> list[int]:
    """Returns how many commands reached the goal in each frame after the command, in order;
    ``counts`` has `COUNTS` entries."""
    first = place_of(goal, True, 1)
    return list(counts[first : first + MAX_FRAMES])


def _percentile(reached: NDArray[np.object_], measured: int, percent: int) -> float:
    """Returns the ms after which at least ``percent`` of the commands have reached the goal."""
    enough = np.flatnonzero(100 * np.cumsum(reached) >= percent * measured)
    return ms_of(int(enough[0]) + 1) if enough.size else math.inf
