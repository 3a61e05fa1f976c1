"""QR-DQN: quantiles of each action's return, by quantile regression (Dabney et al. 2018).

For each action the network returns N atoms θ_i: the return's distribution has the share
τ̂_i = (2i + 1) / 2N below θ_i (lemma 2). Only the loss keeps the atoms in order. A value is the mean
over the atoms, and the values choose the next action: with ``target`` double those of the online
network (as in Double DQN), otherwise those of the target network (algorithm 1). The loss is the
quantile Huber loss with κ = 1 (equation 10).
"""

from functools import partial

import torch
from torch import Tensor

from common.native.quantile_huber import native_quantile_huber
from common.network import QNetwork
from common.settings.config import LearningConfig
from learner.algorithm.double_dqn import huber, online_values
from learner.algorithm.interface import Prepared, Update
from learner.algorithm.value_based import ValueBased
from learner.device import Device


def qr_dqn(network: QNetwork, config: LearningConfig, device: Device, seed: int = 0) -> ValueBased:
    """Returns the algorithm ``qr_dqn``; the atoms of ``network`` are the quantiles."""
    return ValueBased(network, QuantileLoss(config, device), config, device, seed)


class QuantileLoss:
    """Quantile Huber loss between all pairs of a prediction's and its target's quantiles.

    Priorities are the magnitudes of the TD errors of the means, not the losses. If returns are
    random, the loss is not 0 even for a distribution that is learned perfectly, and its transitions
    would be drawn for ever. Priorities, and the metric of how well rewards are predicted, thus mean
    the same as with DQN.
    """

    def __init__(self, config: LearningConfig, device: Device) -> None:
        self._double = config.target == "double"
        self._losses = quantile_huber
        if device.native:
            self._losses = partial(native_quantile_huber, device.native)

    def target_outputs(self, target: QNetwork, prepared: Prepared) -> tuple[Tensor]:
        """Returns the quantiles of ``s_t``, ``float32 [batch, actions, N]``."""
        return (target.atoms(prepared.pixels_t, prepared.batch.x_t),)

    def __call__(self, online: QNetwork, prepared: Prepared) -> Update:
        batch, (quantiles_t,) = prepared.batch, prepared.target_outputs
        q_t = online_values(online, prepared) if self._double else quantiles_t.mean(dim=2)
        targets = target_quantiles(batch.r_t, batch.discount_t, quantiles_t, q_t)
        quantiles_tm1 = online.atoms(prepared.pixels_tm1, batch.x_tm1)
        predicted = of_action(quantiles_tm1, batch.a_tm1)
        losses = self._losses(predicted, targets)
        means = targets.mean(dim=1)
        errors = means - predicted.detach().mean(dim=1)
        return Update((batch.weights * losses).mean(), errors.abs(), errors, means)


def of_action(quantiles: Tensor, actions: Tensor) -> Tensor:
    """Returns the quantiles of one action of each state, ``[batch, N]``.

    Args:
        quantiles: ``[batch, actions, N]``.
        actions: ``int64 [batch]``.
    """
    return quantiles[torch.arange(len(actions), device=actions.device), actions]


def target_quantiles(r_t: Tensor, discount_t: Tensor, quantiles_t: Tensor, q_t: Tensor) -> Tensor:
    """Returns r + γ·θ_j(s_t, a*) without a gradient, ``float32 [batch, N]``.

    Args:
        r_t: n-step return up to ``s_t``, ``float32 [batch]``.
        discount_t: discount of what follows ``s_t``, 0 where the episode ended, ``[batch]``.
        quantiles_t: the target network's quantiles ``[batch, actions, N]``.
        q_t: values whose highest chooses a*, ``[batch, actions]``.
    """
    best = of_action(quantiles_t, q_t.argmax(dim=1))
    return (r_t[:, None] + discount_t[:, None] * best).detach()


def quantile_huber(predicted: Tensor, targets: Tensor) -> Tensor:
    """Returns the quantile Huber loss of each transition, κ = 1, ``float32 [batch]``.

    Σ_i 1/N' Σ_j |τ̂_i - 1{u_ij < 0}| · L(u_ij) with u_ij = target_j - θ_i, where L is Huber's.

    Args:
        predicted: θ ``[batch, N]``, with a gradient.
        targets: ``[batch, N']``, without.
    """
    count = predicted.shape[1]
    midpoints = (torch.arange(count, device=predicted.device) + 0.5) / count
    u = targets[:, None, :] - predicted[:, :, None]
    asymmetry = (midpoints[None, :, None] - (u.detach() < 0).float()).abs()
    return (asymmetry * huber(u)).mean(dim=2).sum(dim=1)
