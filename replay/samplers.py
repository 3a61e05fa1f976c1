"""Samplers: the steps that may be drawn, and the probability of each."""

from typing import Self

import numpy as np
from numpy.typing import NDArray

from common.settings.config import ReplayConfig
from replay.sum_tree import SumTree

_SMALLEST = 1e-6  # a step with priority 0 would never be drawn, so never corrected, again
_LARGEST = float(np.finfo(np.float32).max)  # priorities arrive as float32; α is at most 1

Ids = NDArray[np.int64]


class UniformSampler:
    """The set of ids that may be drawn, each with the same probability.

    It is kept as a dense array of ids, and the place in it of each slot's id.
    """

    def __init__(self, capacity: int, ids: Ids) -> None:
        """``ids`` are the initial members of the set."""
        self._capacity = capacity
        self._count = 0
        self._ids = np.zeros(capacity, np.int64)
        self._places = np.full(capacity, -1, np.int32)
        UniformSampler.add(self, ids)

    @classmethod
    def of_run(
        cls, capacity: int, ids: Ids, leaves: NDArray[np.float64], config: ReplayConfig
    ) -> Self:
        """See `common.registry.SamplerKind`."""
        return cls(capacity, ids)

    def __len__(self) -> int:
        return self._count

    @property
    def ids(self) -> Ids:
        """All ids, in no particular order; a view that the next change invalidates."""
        return self._ids[: self._count]

    def add(self, ids: Ids) -> None:
        """Adds ``ids``, which must be distinct, absent, and of slots without another id in the
        set."""
        end = self._count + len(ids)
        self._ids[self._count : end] = ids
        self._places[ids % self._capacity] = np.arange(self._count, end)
        self._count = end

    def remove(self, ids: Ids) -> None:
        """Removes ``ids``, which must be distinct and present; ids from the end take their
        places."""
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
        """Returns which of ``ids`` are in the set."""
        places = self._places[ids % self._capacity]
        found: NDArray[np.bool_] = (places >= 0) & (self._ids[places] == ids)
        return found

    def draw(self, rng: np.random.Generator, count: int) -> tuple[Ids, NDArray[np.float32]]:
        """Returns ``count`` ids, with replacement, and their importance weights."""
        return self.ids[rng.integers(len(self), size=count)], np.ones(count, np.float32)

    def update(self, ids: Ids, priorities: NDArray[np.float64]) -> None:
        """Takes new priorities ≥ 0, which have no effect here. Ids that are gone are ignored."""


class PrioritisedSampler(UniformSampler):
    """Draws each step in proportion to its priority (Schaul et al. 2016, sections 3.3 and 3.4)."""

    def __init__(
        self, capacity: int, ids: Ids, leaves: NDArray[np.float64], alpha: float, beta: float
    ) -> None:
        """``leaves`` holds the priorities, to the power of α, that an earlier process gave to
        ``ids``, or zeros."""
        super().__init__(capacity, ids)
        self._alpha = alpha
        self._beta = beta
        values = leaves[ids % capacity]
        usable = (values > 0) & (values <= _LARGEST)  # the disk may have changed them
        self._largest = float(values.max(initial=0.0, where=usable)) or 1.0
        leaves[:] = 0.0
        leaves[ids % capacity] = np.where(usable, values, self._largest)
        self._tree = SumTree(leaves)

    @classmethod
    def of_run(
        cls, capacity: int, ids: Ids, leaves: NDArray[np.float64], config: ReplayConfig
    ) -> Self:
        return cls(capacity, ids, leaves, config.priority_exponent, config.importance_exponent)

    def add(self, ids: Ids) -> None:
        """See `UniformSampler.add`. New ids get the largest value so far, so each is drawn soon."""
        super().add(ids)
        self._tree.set(ids % self._capacity, self._largest)

    def remove(self, ids: Ids) -> None:
        super().remove(ids)
        self._tree.set(ids % self._capacity, 0.0)

    def draw(self, rng: np.random.Generator, count: int) -> tuple[Ids, NDArray[np.float32]]:
        total = self._tree.total
        slots = self._tree.find(rng.random(count) * total)
        chances = self._tree.get(slots) / total
        weights = (len(self) * chances) ** -self._beta
        ids = self._ids[self._places[slots]]
        return ids, (weights / weights.max()).astype(np.float32)

    def update(self, ids: Ids, priorities: NDArray[np.float64]) -> None:
        there = self.contains(ids)
        if not there.any():
            return
        values = (priorities[there] + _SMALLEST) ** self._alpha
        self._largest = max(self._largest, float(values.max()))
        self._tree.set(ids[there] % self._capacity, values)
