"""`EmaNetwork`: the weights that actors play by, the online network's or their moving average."""

import copy

import torch
from torch import Tensor

from common.network import QNetwork

PERIOD = 4
"""The weights are averaged in every so many updates. To do so at each would take a thirtieth of an
update's time, and weights that are four updates apart hardly differ."""


class EmaNetwork:
    """The network whose weights are published, tested and evaluated.

    With a ``decay`` d per update it has the exponential moving average of the online network's
    weights, which is steadier than the weights themselves (Polyak and Juditsky 1992): at each k-th
    update, w̄ ← dᵏ·w̄ + (1-dᵏ)·w, where k is `PERIOD`. During the first 1/(1-d) updates it has the
    plain mean of every k-th weights, and those of the latest update before the k-th, so that the
    initial weights do not last. With d = 0 it is the online network itself.
    """

    def __init__(self, online: QNetwork, decay: float) -> None:
        self.network = copy.deepcopy(online).requires_grad_(False) if decay else online
        self._decay = decay
        self._weights: list[Tensor] = list(online.parameters())
        self._means: list[Tensor] = list(self.network.parameters())

    @torch.no_grad()
    def take(self, updates: int) -> None:
        """Averages in the online network's weights after ``updates``, at least 1."""
        if self._decay and (updates % PERIOD == 0 or updates < PERIOD):
            share = max(1 - self._decay**PERIOD, min(1, PERIOD / updates))
            torch._foreach_lerp_(self._means, self._weights, share)
