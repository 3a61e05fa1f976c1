"""DQN (Mnih et al. 2015) and Double DQN (van Hasselt et al. 2016).

Equations 2 to 4 are those of the 2017 report. Names are indexed by time: the agent did ``a_tm1`` in
``s_tm1``, got ``r_t`` and came to ``s_t``.
"""

from typing import Literal

import torch
from torch import Tensor
from torch.nn.functional import huber_loss

from common.network import QNetwork
from common.settings.config import LearningConfig
from learner.algorithm.interface import Prepared, Update
from learner.algorithm.value_based import ValueBased
from learner.device import Device


def double_dqn(
    network: QNetwork, config: LearningConfig, device: Device, seed: int = 0
) -> ValueBased:
    """Returns the algorithm ``dqn``; ``config.target`` says whether it is Double DQN."""
    return ValueBased(network, DoubleDqnLoss(config), config, device, seed)


class DoubleDqnLoss:
    """Mean square or Huber loss of TD errors; priorities are their magnitudes."""

    def __init__(self, config: LearningConfig) -> None:
        self._double = config.target == "double"
        self._kind = config.loss
        self._over_outputs = config.loss_mean_over == "outputs"

    def target_outputs(self, target: QNetwork, prepared: Prepared) -> tuple[Tensor]:
        """Returns the values of ``s_t``, ``float32 [batch, actions]``."""
        return (target(prepared.pixels_t, prepared.batch.x_t),)

    def __call__(self, online: QNetwork, prepared: Prepared) -> Update:
        batch, (q_t_target,) = prepared.batch, prepared.target_outputs
        q_t_online = online_values(online, prepared) if self._double else None
        q_tm1 = online(prepared.pixels_tm1, batch.x_tm1)
        v_t = bootstrap_values(q_t_target, q_t_online)
        targets = td_targets(batch.r_t, batch.discount_t, v_t)
        errors = td_errors(q_tm1, batch.a_tm1, targets)
        outputs = q_tm1.shape[1] if self._over_outputs else 1
        loss = td_loss(errors, batch.weights, self._kind, outputs)
        errors = errors.detach()
        return Update(loss, errors.abs(), errors, targets)


@torch.no_grad()
def online_values(online: QNetwork, prepared: Prepared) -> Tensor:
    """Returns the values of ``s_t`` that choose the next actions, ``float32 [batch, actions]``:
    those that were prepared, or else those of the ``online`` network."""
    if prepared.q_t is not None:
        return prepared.q_t
    values: Tensor = online(prepared.pixels_t, prepared.batch.x_t)
    return values


def bootstrap_values(q_t_target: Tensor, q_t_online: Tensor | None) -> Tensor:
    """Returns the value of each ``s_t``, ``float32 [batch]``.

    Args:
        q_t_target: target network's values ``[batch, actions]``.
        q_t_online: the online network's values, which then choose the action (Double DQN,
            equation 4; van Hasselt et al. 2016); None lets the target network choose too (DQN,
            equation 3; Mnih et al. 2015).
    """
    chooser = q_t_target if q_t_online is None else q_t_online
    return q_t_target.gather(1, chooser.argmax(dim=1, keepdim=True)).squeeze(1)


def td_targets(r_t: Tensor, discount_t: Tensor, v_t: Tensor) -> Tensor:
    """Returns r + γ·v without a gradient, ``float32 [batch]``.

    Args:
        r_t: n-step return up to ``s_t``, ``float32 [batch]``.
        discount_t: discount of ``v_t``, 0 where the episode terminated, ``float32 [batch]``.
        v_t: value of ``s_t``, ``float32 [batch]``.
    """
    return (r_t + discount_t * v_t).detach()


def td_errors(q_tm1: Tensor, a_tm1: Tensor, targets: Tensor) -> Tensor:
    """Returns δ, ``targets`` less Q(s, a), ``float32 [batch]``.

    Args:
        q_tm1: ``float32 [batch, actions]``.
        a_tm1: ``int64 [batch]``.
        targets: ``float32 [batch]``.
    """
    return targets - q_tm1.gather(1, a_tm1.unsqueeze(1)).squeeze(1)


def td_loss(
    errors: Tensor, weights: Tensor, kind: Literal["mse", "huber"], outputs: int = 1
) -> Tensor:
    """Returns the weighted mean loss of TD errors (equation 2).

    Args:
        errors: δ ``[batch]``.
        weights: importance weights ``[batch]``; 1 for uniform sampling.
        kind: δ², or Huber's loss.
        outputs: divides the mean; the 2017 code averaged over the outputs of all actions, although
            all but one had no error.
    """
    losses = errors.square() if kind == "mse" else huber(errors)
    return (weights * losses).mean() / outputs


def huber(errors: Tensor) -> Tensor:
    """Returns Huber's loss of each error δ: ½δ² up to |δ| = 1, and |δ| - ½ beyond."""
    return huber_loss(errors, torch.zeros_like(errors), reduction="none")
