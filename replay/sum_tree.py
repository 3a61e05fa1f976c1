"""A sum tree over slots: draws slots in proportion to their values with a few NumPy calls.

Each node has 32 children instead of two. One long row replaces the root, because a search in a row
of thousands costs less than another level: for a million slots, that row has 992 sums, with two
levels below it. All draws of a batch descend together. Parents are recomputed from their children,
so rounding errors do not accumulate.
"""

import numpy as np
from numpy.typing import NDArray

FANOUT = 32
_WIDEST = 8_192
"""Maximum length of the top row."""


def padded(capacity: int) -> int:
    """Returns the length of the array of leaves for ``capacity`` slots."""
    return -(-capacity // FANOUT) * FANOUT


class SumTree:
    """Values ≥ 0 of slots 0 … len(leaves) - 1, kept in ``leaves``, which the tree writes to."""

    def __init__(self, leaves: NDArray[np.float64]) -> None:
        self._leaves = leaves
        self._rows = [leaves]
        """The leaves, the sums of 32 leaves each, and so on to the top row."""
        while len(self._rows) == 1 or len(self._rows[-1]) > _WIDEST:
            nodes = self._rows[-1].reshape(-1, FANOUT)
            sums = np.zeros(padded(len(nodes)))
            sums[: len(nodes)] = nodes.sum(axis=1)
            self._rows.append(sums)

    @property
    def total(self) -> float:
        """Sum of all values."""
        return float(self._rows[-1].sum())

    def get(self, slots: NDArray[np.int64]) -> NDArray[np.float64]:
        """Returns the values of ``slots``."""
        return self._leaves[slots]

    def set(self, slots: NDArray[np.int64], values: NDArray[np.float64] | float) -> None:
        """Sets the values of ``slots``; if a slot occurs twice, its last value counts."""
        self._leaves[slots] = values
        for row, above in zip(self._rows, self._rows[1:], strict=False):
            slots = slots // FANOUT
            above[slots] = row.reshape(-1, FANOUT).take(slots, axis=0).sum(axis=1)

    def find(self, targets: NDArray[np.float64]) -> NDArray[np.int64]:
        """Returns, for each target in [0, total), the slot at which the running sum exceeds it."""
        top = self._rows[-1]
        sums = top.cumsum()
        # Rounding may put a target above the sum; it must not run past the last value.
        targets = np.minimum(targets, np.nextafter(sums[-1], 0.0))
        found: NDArray[np.int64] = sums.searchsorted(targets, "right")
        targets = targets - (sums[found] - top[found])
        each = np.arange(len(targets))
        for row in self._rows[-2::-1]:
            children = row.reshape(-1, FANOUT).take(found, axis=0)
            sums = children.cumsum(axis=1)
            # Nor may it be below 0, which would find a first child of value 0.
            targets = np.minimum(np.maximum(targets, 0.0), np.nextafter(sums[:, -1], 0.0))
            child = (sums > targets[:, None]).argmax(axis=1)
            targets = targets - (sums[each, child] - children[each, child])
            found = found * FANOUT + child
        return found
