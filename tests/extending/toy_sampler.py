"""A sampler of another package: draws the newest steps alone, and counts how often."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from common.checked import FromOne
from common.registry import SamplerKind
from common.settings.config import ReplayConfig
from common.settings.own_settings import own_settings
from replay.samplers import Ids, UniformSampler


@dataclass(frozen=True)
class Settings:
    newest: FromOne = 100
    """Number of steps to draw from."""


class NewestSampler(UniformSampler):
    """Counts in ``leaves`` how often the step of each slot was told a priority."""

    def __init__(self, capacity: int, ids: Ids, leaves: NDArray[np.float64], newest: int) -> None:
        super().__init__(capacity, ids)
        self._counts = leaves[:capacity]
        self._newest = newest

    @classmethod
    def of_run(
        cls, capacity: int, ids: Ids, leaves: NDArray[np.float64], config: ReplayConfig
    ) -> Self:
        return cls(capacity, ids, leaves, own_settings(Settings, config.sampler_settings).newest)

    def draw(self, rng: np.random.Generator, count: int) -> tuple[Ids, NDArray[np.float32]]:
        newest = np.sort(self.ids)[-self._newest :]
        return rng.choice(newest, count), np.ones(count, np.float32)

    def update(self, ids: Ids, priorities: NDArray[np.float64]) -> None:
        there = ids[self.contains(ids)]
        np.add.at(self._counts, there % len(self._counts), 1)


NEWEST = SamplerKind("newest", NewestSampler.of_run, prioritised=True, settings=Settings)
