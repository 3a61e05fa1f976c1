"""How often something can be done in a second."""

import time
from collections.abc import Callable

import numpy as np

SLICES = 5


def per_second(action: Callable[[], object], seconds: float) -> float:
    """Calls of ``action`` per second: the median of five slices, so that one bad moment is none."""
    return float(np.median([slice_per_second(action, seconds / SLICES) for _ in range(SLICES)]))


def slice_per_second(action: Callable[[], object], seconds: float) -> float:
    """Calls of ``action`` per second, over at least ``seconds`` and one call."""
    calls = 0
    began = time.perf_counter()
    while True:
        action()
        calls += 1
        spent = time.perf_counter() - began
        if spent >= seconds:
            return calls / spent
