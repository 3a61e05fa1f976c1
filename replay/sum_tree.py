"""A sum tree over slots: draw a slot in proportion to its value, in a handful of numpy calls.

Each node has 32 children instead of the usual two: four levels hold a million slots, and all
draws of a batch go down together. Parents are summed afresh from their children, so rounding
does not build up.
"""

import numpy as np
from numpy.typing import NDArray

FANOUT = 32


def padded(capacity: int) -> int:
    """Length of the array of leaves for ``capacity`` slots."""
    return -(-capacity // FANOUT) * FANOUT


class SumTree:
    """Values ≥ 0 of slots 0 … len(leaves) - 1; ``leaves`` is kept and changed in place."""

    def __init__(self, leaves: NDArray[np.float64]) -> None:
        rows = leaves.reshape(-1, FANOUT)
        self._leaves = leaves
        self._levels = [rows]
        while len(rows) > 1:
            sums = np.zeros(padded(len(rows)))
            sums[: len(rows)] = rows.sum(axis=1)
            rows = sums.reshape(-1, FANOUT)
            self._levels.append(rows)

    @property
    def total(self) -> float:
        return float(self._levels[-1].sum())

    def get(self, slots: NDArray[np.int64]) -> NDArray[np.float64]:
        """Values of ``slots``."""
        return self._leaves[slots]

    def set(self, slots: NDArray[np.int64], values: NDArray[np.float64] | float) -> None:
        """Give ``slots`` new values; of a slot named twice the last value stays."""
        self._leaves[slots] = values
        rows = slots
        for children, parents in zip(self._levels, self._levels[1:], strict=False):
            rows = rows // FANOUT
            parents.reshape(-1)[rows] = children[rows].sum(axis=1)

    def find(self, targets: NDArray[np.float64]) -> NDArray[np.int64]:
        """For each target in [0, total): the slot at which the running sum passes it."""
        rows = np.zeros(len(targets), np.int64)
        each = np.arange(len(targets))
        for level in reversed(self._levels):
            sums = np.zeros((len(targets), FANOUT + 1))
            np.cumsum(level[rows], axis=1, out=sums[:, 1:])
            # A target may exceed the sum by rounding; it must not run past the last child.
            targets = np.minimum(targets, np.nextafter(sums[:, -1], 0.0))
            child = (sums[:, 1:] <= targets[:, None]).sum(axis=1)
            targets = targets - sums[each, child]
            rows = rows * FANOUT + child
        return rows
