"""Which weights actors play by: the online network's, or their mean over the latest updates."""

import copy

import torch
from torch import Tensor

from common.network import QNetwork


class PublishedNetwork:
    """The network whose weights are published, tested and evaluated.

    With a ``decay`` d it has the exponential mean of the online network's weights,
    w̄ ← d·w̄ + (1-d)·w, which is steadier than these (Polyak and Juditsky 1992); in its first
    1/(1-d) updates the plain mean, so that the initial weights do not last. With d = 0 it is the
    online network itself.
    """

    def __init__(self, online: QNetwork, decay: float) -> None:
        self.network = copy.deepcopy(online).requires_grad_(False) if decay else online
        self._least_share = 1 - decay
        self._weights: list[Tensor] = list(online.parameters())
        self._means: list[Tensor] = list(self.network.parameters())

    @torch.no_grad()
    def take(self, updates: int) -> None:
        """Count in the online network's weights, which come of so many ``updates``, 1 or more."""
        if self._least_share < 1:
            share = max(self._least_share, 1 / updates)
            torch._foreach_lerp_(self._means, self._weights, share)
