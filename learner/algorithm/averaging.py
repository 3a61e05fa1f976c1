"""Which weights actors get: the online network's, or an exponential mean of them."""

import copy
from typing import Generic, Protocol, TypeVar

import torch
from torch import Tensor

from common.network import QNetwork
from common.run.config import LearningConfig

Network = TypeVar("Network", bound=QNetwork)
AnyNetwork = TypeVar("AnyNetwork", bound=QNetwork, covariant=True)


class Published(Protocol[AnyNetwork]):
    """The network whose weights are published, tested and evaluated."""

    @property
    def network(self) -> AnyNetwork:
        """The network to publish."""

    def update(self) -> None:
        """Take notice of a gradient step of the online network."""


class Online(Generic[Network]):
    """Publishes the online network itself."""

    def __init__(self, online: Network) -> None:
        self.network = online

    def update(self) -> None:
        """Nothing to do."""


class ExponentialMean(Generic[Network]):
    """Publishes w̄ ← d·w̄ + (1-d)·w of the online weights w, which begins with the first ones."""

    def __init__(self, online: Network, decay: float) -> None:
        self.network = copy.deepcopy(online).requires_grad_(False)
        self._share = 1 - decay
        self._weights: list[Tensor] = list(online.parameters())
        self._means: list[Tensor] = list(self.network.parameters())

    @torch.no_grad()
    def update(self) -> None:
        torch._foreach_lerp_(self._means, self._weights, self._share)


def build_published(online: Network, config: LearningConfig) -> Published[Network]:
    """Returns what ``config`` asks to publish of ``online``."""
    if not config.weights_average:
        return Online(online)
    return ExponentialMean(online, config.weights_average)
