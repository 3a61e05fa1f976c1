"""Which weights actors get: the online network's, or an exponential mean of them."""

import copy

import torch
from torch import Tensor

from common.network import QNetwork


class PublishedNetwork:
    """The network whose weights are published, tested and evaluated.

    Its weights are w̄ ← d·w̄ + (1-d)·w of the online weights w and begin with the first of these;
    with a ``decay`` d of 0 it is the online network itself.
    """

    def __init__(self, online: QNetwork, decay: float) -> None:
        self.network = copy.deepcopy(online).requires_grad_(False) if decay else online
        self._share = 1 - decay
        self._weights: list[Tensor] = list(online.parameters())
        self._means: list[Tensor] = list(self.network.parameters())

    @torch.no_grad()
    def update(self) -> None:
        """Take notice of a gradient step of the online network."""
        if self._share < 1:
            torch._foreach_lerp_(self._means, self._weights, self._share)
