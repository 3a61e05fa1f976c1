"""Q-values as bars of text, for the screens of training and of watching."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from common.minus import minus_signed


def q_bars(values: NDArray[np.floating], rows: int, width: int) -> Iterator[tuple[int, str, str]]:
    """Yields index, Q-value and bar of the ``rows`` best actions, in the order of the actions.

    A value is written with three decimals, in at least eight characters.

    Args:
        values: Q-values of all actions, finite; the bar of the lowest is empty.
        width: columns of the bar of the highest.
    """
    least, span = float(values.min()), float(np.ptp(values)) or 1.0
    for index in sorted(np.argsort(-values, kind="stable")[:rows].tolist()):
        value = float(values[index])
        told = minus_signed(f"{value:,.3f}")
        yield index, f"{told:>8}", "█" * round((value - least) / span * width)
