"""The optimizers of the presets, and the bound on their gradients."""

from collections.abc import Iterable

import torch
from torch import nn

from common.config import LearningConfig


def build_optimizer(
    parameters: Iterable[nn.Parameter], config: LearningConfig
) -> torch.optim.Optimizer:
    """Adam, or RMSprop by the formula of TensorFlow and Keras.

    Keras: ``v ← ρv + (1-ρ)g²;  w ← w - lr·g / (√v + ε)``, which is PyTorch's with alpha = ρ; the
    centred variant of Mnih et al. 2015 was not used in 2017.
    """
    if config.optimizer == "adam":
        # The fused kernel does the same arithmetic in one pass over memory.
        return torch.optim.Adam(
            parameters, lr=config.learning_rate, eps=config.optimizer_epsilon, fused=True
        )
    return torch.optim.RMSprop(
        parameters,
        lr=config.learning_rate,
        alpha=config.rmsprop_decay,
        eps=config.optimizer_epsilon,
    )


@torch.no_grad()
def clip_gradients(parameters: Iterable[nn.Parameter], longest: float) -> None:
    """Scale all gradients so that together they are no longer than ``longest``.

    As `torch.nn.utils.clip_grad_norm_`, which also multiplies those that are short enough, by 1.
    """
    gradients = [p.grad for p in parameters if p.grad is not None]
    length = torch.linalg.vector_norm(torch.stack(torch._foreach_norm(gradients)))
    # On CUDA, asking whether it is too long would wait for the device.
    if length.is_cuda or length > longest:
        torch._foreach_mul_(gradients, torch.clamp(longest / (length + 1e-6), max=1.0))
