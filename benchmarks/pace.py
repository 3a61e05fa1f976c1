"""Measures rates per second on a machine whose speed changes by the minute.

Contenders take turns (`in_turns`), so that a slow moment affects all alike and ratios hold. A
figure is the median over turns, with the least and the most (`Spread`).
"""

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

SLICES = 5

K = TypeVar("K")
T = TypeVar("T")


class Spread(NamedTuple):
    """A figure over several turns."""

    median: float
    least: float
    most: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        return cls(float(np.median(values)), min(values), max(values))

    def cells(self) -> dict[str, float]:
        """Returns three columns of a table."""
        return {"per second": self.median, "least": self.least, "most": self.most}


def in_turns(
    contenders: Mapping[K, Callable[[], T]], turns: int, *, warm_up: int = 1, tell: bool = False
) -> dict[K, list[T]]:
    """Lets each contender work once a turn; returns the results of each, turn by turn.

    Args:
        warm_up: number of turns before the measured ones, which do not count.
        tell: whether to print each turn's end.
    """
    found: dict[K, list[T]] = {name: [] for name in contenders}
    for turn in range(1 - warm_up, turns + 1):
        for name, work in contenders.items():
            result = work()
            if turn > 0:
                found[name].append(result)
        if tell:
            print(f"turn {turn} of {turns}", file=sys.stderr, flush=True)
    return found


def per_second(action: Callable[[], object], seconds: float) -> float:
    """Returns the calls of ``action`` per second: the median of five slices of ``seconds``."""
    return float(np.median([slice_per_second(action, seconds / SLICES) for _ in range(SLICES)]))


def slice_per_second(action: Callable[[], object], seconds: float) -> float:
    """Returns the calls of ``action`` per second, over at least ``seconds`` and one call."""
    calls, spent = repeat(action, seconds)
    return calls / spent


def repeat(action: Callable[[], object], seconds: float) -> tuple[int, float]:
    """Calls ``action`` for at least ``seconds``, and once; returns the calls and the seconds."""
    calls, spent, began = 0, 0.0, time.perf_counter()
    while not calls or spent < seconds:
        action()
        calls += 1
        spent = time.perf_counter() - began
    return calls, spent
