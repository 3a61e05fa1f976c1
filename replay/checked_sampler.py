"""`CheckedSampler`: a run's sampler, which may be another package's; what it does wrong is told."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.checked import MAX_LONG_TEXT
from common.errors import InputError
from common.registry import SAMPLERS, failure
from common.settings.config import ReplayConfig
from replay.samplers import Ids, PrioritisedSampler, UniformSampler

_OUR_OWN = (UniformSampler, PrioritisedSampler)
"""Samplers whose draws need no check, which takes 20 to 50 µs, 4 to 9 % of a minibatch's time."""
_KEPT = ("__len__", "contains", "ids")
"""What a subclass must leave alone: the store asks for it in the middle of an insert."""


class CheckedSampler:
    """Passes calls on to the sampler that ``config`` names.

    If the sampler fails, or draws what it should not, that call and all later ones that change the
    set or draw from it raise InputError: the set may lack steps, or have evicted ones.
    """

    def __init__(self, ids: Ids, leaves: NDArray[np.float64], config: ReplayConfig) -> None:
        """See `common.registry.SamplerKind`. Raises InputError if there is no such sampler, if its
        factory fails, or if it overrides what it must not."""
        self.failed = ""
        """See `replay.chunk_statistics.ReplayProgress.failed`."""
        self._who = f"the sampler {config.sampler!r}"
        self._sampler: UniformSampler = SAMPLERS.make(
            config.sampler, config.capacity, ids, leaves, config
        )
        if not isinstance(self._sampler, UniformSampler):
            raise InputError(
                f"the factory of {self._who} returns {type(self._sampler).__name__}: return a "
                "UniformSampler or a subclass's object."
            )
        kind = type(self._sampler)
        self._foreign = kind not in _OUR_OWN
        for name in _KEPT:
            if getattr(kind, name) is not getattr(UniformSampler, name):
                raise InputError(
                    f"{self._who} overrides {name}: leave it to UniformSampler, and override draw."
                )

    def __len__(self) -> int:
        return len(self._sampler)

    @property
    def ids(self) -> Ids:
        """See `UniformSampler.ids`."""
        return self._sampler.ids

    def contains(self, ids: Ids) -> NDArray[np.bool_]:
        """See `UniformSampler.contains`."""
        return self._sampler.contains(ids)

    def add(self, ids: Ids) -> None:
        """See `UniformSampler.add`."""
        with self._working():
            self._sampler.add(ids)

    def remove(self, ids: Ids) -> None:
        """See `UniformSampler.remove`."""
        with self._working():
            self._sampler.remove(ids)

    def update(self, ids: Ids, priorities: NDArray[np.float64]) -> None:
        """See `UniformSampler.update`."""
        with self._working():
            self._sampler.update(ids, priorities)

    def draw(self, rng: np.random.Generator, count: int) -> tuple[Ids, NDArray[np.float32]]:
        """See `UniformSampler.draw`. Other steps would be learned from in silence, so ids and
        weights of another package's sampler are checked."""
        with self._working():
            ids, weights = map(np.asarray, self._sampler.draw(rng, count))
            if self._foreign:
                self._check_draw(ids, weights, count)
        return ids, weights

    @contextmanager
    def _working(self) -> Iterator[None]:
        if self.failed:
            raise InputError(self.failed)
        try:
            yield
        except Exception as error:  # of any kind, as the package may not be ours
            told = str(error) if isinstance(error, InputError) else failure(self._who, error)
            self.failed = told[:MAX_LONG_TEXT]
            raise InputError(self.failed) from error

    def _check_draw(self, ids: NDArray[Any], weights: NDArray[Any], count: int) -> None:
        if [ids.dtype, weights.dtype] != [np.int64, np.float32] or not (
            ids.shape == weights.shape == (count,)
        ):
            raise InputError(
                f"{self._who} draws {ids.dtype} {list(ids.shape)} and {weights.dtype} "
                f"{list(weights.shape)}: return ids int64 [{count}] and weights float32 [{count}]."
            )
        gone = ids[~self.contains(ids)]
        if gone.size:
            raise InputError(
                f"{self._who} draws step {gone[0]}, which is not in its set: draw from its ids."
            )
        if not (np.isfinite(weights) & (weights >= 0)).all():
            raise InputError(
                f"{self._who} gives negative or non-finite weights: give weights from 0 on."
            )
