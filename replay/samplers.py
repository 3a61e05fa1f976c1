"""Which steps may be drawn, and how likely each is."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from replay.sum_tree import SumTree

_SMALLEST = 1e-6  # a priority of 0 would never be drawn, nor corrected, again

Ids = NDArray[np.int64]


class SampleableIndex:
    """The ids of steps that may be drawn: a dense array, and each slot's place in it."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._count = 0
        self._ids = np.zeros(capacity, np.int64)
        self._places = np.full(capacity, -1, np.int32)

    def __len__(self) -> int:
        return self._count

    @property
    def ids(self) -> Ids:
        """All of them, in no order; a view that the next change makes invalid."""
        return self._ids[: self._count]

    def add(self, ids: Ids) -> None:
        """``ids`` are distinct, absent, and of slots that no other id in the set has."""
        end = self._count + len(ids)
        self._ids[self._count : end] = ids
        self._places[ids % self._capacity] = np.arange(self._count, end)
        self._count = end

    def remove(self, ids: Ids) -> None:
        """``ids`` are distinct and present; others from the end take their places."""
        slots = ids % self._capacity
        places = self._places[slots]
        self._places[slots] = -1
        end = self._count - len(ids)
        tail = self._ids[end : self._count]
        movers = tail[self._places[tail % self._capacity] >= 0]
        holes = places[places < end]
        self._ids[holes] = movers
        self._places[movers % self._capacity] = holes
        self._count = end

    def contains(self, ids: Ids) -> NDArray[np.bool_]:
        """Which of ``ids`` are in the set."""
        places = self._places[ids % self._capacity]
        found: NDArray[np.bool_] = (places >= 0) & (self._ids[places] == ids)
        return found

    def at_slots(self, slots: Ids) -> Ids:
        """The ids at ``slots``, which have some."""
        return self._ids[self._places[slots]]


class Sampler(Protocol):
    """Draws from the steps it was given."""

    sampleable: SampleableIndex

    def add(self, ids: Ids) -> None:
        """Make ``ids``, which are distinct and absent, sampleable."""

    def restore(self, ids: Ids) -> None:
        """Make ``ids`` sampleable that an earlier process had stored."""

    def remove(self, ids: Ids) -> None:
        """Strike ``ids``, which are distinct and present."""

    def draw(self, rng: np.random.Generator, count: int) -> tuple[Ids, NDArray[np.float32]]:
        """``count`` ids, with replacement, and their importance weights."""

    def update(self, ids: Ids, priorities: NDArray[np.float64]) -> None:
        """New priorities ≥ 0; ids that are no longer there are passed over."""


class UniformSampler:
    """Each step is as likely as any other."""

    def __init__(self, capacity: int) -> None:
        self.sampleable = SampleableIndex(capacity)

    def add(self, ids: Ids) -> None:
        self.sampleable.add(ids)

    def restore(self, ids: Ids) -> None:
        self.sampleable.add(ids)

    def remove(self, ids: Ids) -> None:
        self.sampleable.remove(ids)

    def draw(self, rng: np.random.Generator, count: int) -> tuple[Ids, NDArray[np.float32]]:
        ids = self.sampleable.ids
        return ids[rng.integers(len(ids), size=count)], np.ones(count, np.float32)

    def update(self, ids: Ids, priorities: NDArray[np.float64]) -> None:
        """Priorities mean nothing here."""


class PrioritisedSampler:
    """Proportional prioritisation (Schaul et al. 2016, section 3.3 and 3.4)."""

    def __init__(
        self, capacity: int, leaves: NDArray[np.float64], alpha: float, beta: float
    ) -> None:
        """``leaves`` holds the priorities of an earlier process, to the power of α, or zeros."""
        self.sampleable = SampleableIndex(capacity)
        self._capacity = capacity
        self._alpha = alpha
        self._beta = beta
        self._earlier = leaves.copy()
        leaves[:] = 0.0
        self._tree = SumTree(leaves)
        self._largest = 1.0

    def restore(self, ids: Ids) -> None:
        """Make ``ids`` sampleable with the priorities that an earlier process left them."""
        values = self._earlier[ids % self._capacity]
        usable = np.isfinite(values) & (values > 0)
        if usable.any():
            self._largest = float(values[usable].max())
        self.sampleable.add(ids)
        self._tree.set(ids % self._capacity, np.where(usable, values, self._largest))

    def add(self, ids: Ids) -> None:
        """New steps get the largest value so far, so that each is drawn soon."""
        self.sampleable.add(ids)
        self._tree.set(ids % self._capacity, self._largest)

    def remove(self, ids: Ids) -> None:
        self.sampleable.remove(ids)
        self._tree.set(ids % self._capacity, 0.0)

    def draw(self, rng: np.random.Generator, count: int) -> tuple[Ids, NDArray[np.float32]]:
        total = self._tree.total
        slots = self._tree.find(rng.random(count) * total)
        chances = self._tree.get(slots) / total
        weights = (len(self.sampleable) * chances) ** -self._beta
        return self.sampleable.at_slots(slots), (weights / weights.max()).astype(np.float32)

    def update(self, ids: Ids, priorities: NDArray[np.float64]) -> None:
        there = self.sampleable.contains(ids)
        if not there.any():
            return
        values = (priorities[there] + _SMALLEST) ** self._alpha
        self._largest = max(self._largest, float(values.max()))
        self._tree.set(ids[there] % self._capacity, values)
