"""Measurement of actuation latency: the time from a command to its keys, for every pair of actions.

The unit is the emulator frame, because the controller is read once per frame. A change ends with
the first frame from which the keys are, and stay, the commanded ones.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from actors.robots.interface import Hands
from common.actions import KEYS_OF_ACTION, Keys
from common.press_latency import MAX_FRAMES, ms_of
from common.settings.conditions import DEFAULT_PLAY

FRAME_MS = ms_of(1)
AGENT_STEP = DEFAULT_PLAY.frame_skip
"""Emulator frames per agent step."""
AGENT_STEP_MS = AGENT_STEP * FRAME_MS
_SETTLED = 3 * AGENT_STEP
_ACTIONS = len(KEYS_OF_ACTION)
CHANGES = 2 * _ACTIONS * (_ACTIONS - 1)
"""Number of changes in one repetition."""


@dataclass(frozen=True)
class Change:
    """One measured change from an old to a new action."""

    old: int
    new: int
    settled: bool
    """Whether the old keys were held for 3 agent steps; if not, for one, as in play."""
    frames: int | None
    """Emulator frames from the command until the keys are right for good; None if not reached."""
    strayed: bool
    """Whether a key of neither action, not held before, was pressed on the way."""


def changes(hands: Hands, repetitions: int, seed: int) -> Iterator[Change]:
    """Yields changes for every ordered pair of actions, ``repetitions`` settled and as many not.

    The order is random, so that the hands start each pair from many positions.
    """
    rng = np.random.default_rng(seed)
    pairs = [(a, b) for a in range(_ACTIONS) for b in range(_ACTIONS) if a != b]
    hands.rest()
    for _ in range(repetitions):
        for settled in (True, False):
            for index in rng.permutation(len(pairs)):
                old, new = pairs[index]
                if not settled:
                    for action in rng.integers(_ACTIONS, size=2):
                        hold(hands, KEYS_OF_ACTION[action], AGENT_STEP)
                before = hold(hands, KEYS_OF_ACTION[old], _SETTLED if settled else AGENT_STEP)[-1]
                wanted = KEYS_OF_ACTION[new]
                way = hold(hands, wanted, MAX_FRAMES)
                allowed = KEYS_OF_ACTION[old] | wanted | before
                wrong = [number for number, keys in enumerate(way, start=1) if keys != wanted]
                frames = max(wrong, default=0) + 1
                yield Change(
                    old,
                    new,
                    settled,
                    frames if frames <= MAX_FRAMES else None,
                    any(keys & ~allowed for keys in way),
                )


def hold(hands: Hands, keys: Keys, frames: int) -> list[Keys]:
    """Commands ``keys`` for so many emulator frames; returns what was held in each of them."""
    hands.command(keys)
    return [hands.step_frame() for _ in range(frames)]


@dataclass(frozen=True)
class Latency:
    """Statistics of many changes; times are in ms and exclude changes that were not reached."""

    changes: int
    p50_ms: float
    p99_ms: float
    unreached: int
    stray_share: float

    @classmethod
    def of(cls, found: list[Change]) -> "Latency":
        """Returns the statistics of at least one change; times are NaN if none was reached."""
        times = np.array([change.frames for change in found if change.frames]) * FRAME_MS
        p50 = p99 = np.nan
        if times.size:
            p50, p99 = np.percentile(times, (50, 99), method="inverted_cdf")
        return cls(
            changes=len(found),
            p50_ms=float(p50),
            p99_ms=float(p99),
            unreached=sum(change.frames is None for change in found),
            stray_share=sum(change.strayed for change in found) / len(found),
        )


GOAL = Latency(CHANGES, AGENT_STEP_MS, 2 * AGENT_STEP_MS, unreached=0, stray_share=0.05)
"""The most that hands should need: half of the changes are over within an agent step, and nearly
all within two."""
