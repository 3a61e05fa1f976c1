"""A sum tree over slots: draw a slot in proportion to its value, in a handful of numpy calls.

Each node has 32 children instead of the usual two, and above the nodes there is one long row
instead of a root, for a search in a row of thousands costs less than another level: a million
slots are a row of 992 sums, and two levels below it. All draws of a batch go down together.
Parents are summed afresh from their children, so rounding does not build up.
"""

import numpy as np
from numpy.typing import NDArray

FANOUT = 32
_WIDEST = 8_192
"""Sums that the row at the top may have."""


def padded(capacity: int) -> int:
    """Length of the array of leaves for ``capacity`` slots."""
    return -(-capacity // FANOUT) * FANOUT


class SumTree:
    """Values ≥ 0 of slots 0 … len(leaves) - 1; ``leaves`` is kept and changed in place."""

    def __init__(self, leaves: NDArray[np.float64]) -> None:
        self._leaves = leaves
        self._rows = [leaves]
        """The leaves, the sums of 32 of them each, and so on to the top."""
        while len(self._rows) == 1 or len(self._rows[-1]) > _WIDEST:
            nodes = self._nodes(self._rows[-1])
            sums = np.zeros(padded(len(nodes)))
            sums[: len(nodes)] = nodes.sum(axis=1)
            self._rows.append(sums)

    @staticmethod
    def _nodes(row: NDArray[np.float64]) -> NDArray[np.float64]:
        return row.reshape(-1, FANOUT)

    @property
    def total(self) -> float:
        return float(self._rows[-1].sum())

    def get(self, slots: NDArray[np.int64]) -> NDArray[np.float64]:
        """Values of ``slots``."""
        return self._leaves[slots]

    def set(self, slots: NDArray[np.int64], values: NDArray[np.float64] | float) -> None:
        """Give ``slots`` new values; of a slot named twice the last value stays."""
        self._leaves[slots] = values
        for row, above in zip(self._rows, self._rows[1:], strict=False):
            slots = slots // FANOUT
            above[slots] = self._nodes(row).take(slots, axis=0).sum(axis=1)

    def find(self, targets: NDArray[np.float64]) -> NDArray[np.int64]:
        """For each target in [0, total): the slot at which the running sum passes it."""
        top = self._rows[-1]
        sums = top.cumsum()
        # A target may exceed the sum by rounding; it must not run past the last value.
        targets = np.minimum(targets, np.nextafter(sums[-1], 0.0))
        found: NDArray[np.int64] = sums.searchsorted(targets, "right")
        targets = targets - (sums[found] - top[found])
        each = np.arange(len(targets))
        for row in self._rows[-2::-1]:
            children = self._nodes(row).take(found, axis=0)
            sums = children.cumsum(axis=1)
            # Nor may it stay below 0, for that would find a first child of no value.
            targets = np.minimum(np.maximum(targets, 0.0), np.nextafter(sums[:, -1], 0.0))
            child = (sums > targets[:, None]).argmax(axis=1)
            targets = targets - (sums[each, child] - children[each, child])
            found = found * FANOUT + child
        return found
