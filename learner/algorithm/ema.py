"""`EmaNetwork`: the weights that actors play by, the online network's or their moving average."""

import copy

import torch
from torch import Tensor

from common.network import QNetwork

PERIOD = 4
"""Updates between two that are averaged in: each of them reads and writes all weights, which would
be a thirtieth of every update, and networks only four updates apart hardly differ."""


class EmaNetwork:
    """The network whose weights are published, tested and evaluated.

    With a ``decay`` d for each update it has the exponential moving average of the online network's
    weights, w̄ ← d⁴·w̄ + (1-d⁴)·w at every fourth update, which is steadier than the weights
    themselves (Polyak and Juditsky 1992). During the first 1/(1-d) updates it has their plain mean,
    so that the initial weights do not last. With d = 0 it is the online network itself.
    """

    def __init__(self, online: QNetwork, decay: float) -> None:
        self.network = copy.deepcopy(online).requires_grad_(False) if decay else online
        self._decay = decay
        self._weights: list[Tensor] = list(online.parameters())
        self._means: list[Tensor] = list(self.network.parameters())

    @torch.no_grad()
    def take(self, updates: int) -> None:
        """Averages in the online network's weights after ``updates``, at least 1."""
        if self._decay and updates % PERIOD == 0:
            share = max(1 - self._decay**PERIOD, PERIOD / updates)
            torch._foreach_lerp_(self._means, self._weights, share)
