"""Targets and losses of DQN and Double DQN: equations 2 to 4 of the report.

Names are indexed by time: the agent did ``a_tm1`` in ``s_tm1``, got ``r_t`` and came to ``s_t``.
"""

from typing import Literal

import torch
from torch import Tensor


def bootstrap_values(q_t_target: Tensor, q_t_online: Tensor | None) -> Tensor:
    """Value of each ``s_t``, ``float32 [batch]``.

    Args:
        q_t_target: target network's values ``[batch, actions]``.
        q_t_online: the online network's values, which then choose the action (Double DQN,
            equation 4; van Hasselt et al. 2016); None lets the target network choose too (DQN,
            equation 3; Mnih et al. 2015).
    """
    chooser = q_t_target if q_t_online is None else q_t_online
    return q_t_target.gather(1, chooser.argmax(dim=1, keepdim=True)).squeeze(1)


def td_errors(q_tm1: Tensor, a_tm1: Tensor, r_t: Tensor, discount_t: Tensor, v_t: Tensor) -> Tensor:
    """δ = r + γ·v − Q(s, a) with the gradient only in Q, ``float32 [batch]``.

    Args:
        q_tm1: ``float32 [batch, actions]``.
        a_tm1: ``int64 [batch]``.
        r_t: n-step return up to ``s_t``, ``float32 [batch]``.
        discount_t: discount of ``v_t``, 0 where the episode terminated, ``float32 [batch]``.
        v_t: value of ``s_t``, ``float32 [batch]``.
    """
    target = (r_t + discount_t * v_t).detach()
    return target - q_tm1.gather(1, a_tm1.unsqueeze(1)).squeeze(1)


def td_loss(
    errors: Tensor, weights: Tensor, kind: Literal["mse", "huber"], outputs: int = 1
) -> Tensor:
    """Weighted mean loss of TD errors (equation 2).

    Args:
        errors: δ ``[batch]``.
        weights: importance weights ``[batch]``; 1 for uniform sampling.
        kind: δ²; or Huber's ½δ² up to |δ| = 1 and |δ| - ½ beyond.
        outputs: divides the mean; the 2017 code averaged over all actions' outputs, of which all
            but one had no error.
    """
    if kind == "mse":
        losses = errors.square()
    else:
        magnitude = errors.abs()
        losses = torch.where(magnitude <= 1, 0.5 * errors.square(), magnitude - 0.5)
    return (weights * losses).mean() / outputs
