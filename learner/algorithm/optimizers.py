"""The optimizers of the presets, and the bound on their gradients."""

from collections.abc import Iterable

import torch
from torch import nn

from common.run.config import LearningConfig

_LONG_AGO = 1e9
"""Steps, after which ρ^steps is 0."""


def build_optimizer(
    parameters: Iterable[nn.Parameter], config: LearningConfig
) -> torch.optim.Optimizer:
    """Adam, or RMSprop by the formula of TensorFlow and Keras.

    Keras: ``v ← ρv + (1-ρ)g²;  w ← w - lr·g / (√v + ε)``, which is PyTorch's with alpha = ρ; the
    centred variant of Mnih et al. 2015 was not used in 2017.
    """
    weights = list(parameters)
    if config.optimizer == "adam":
        return _adam(weights, config, (0.9, 0.999))
    # Adam whose gradients are their own means, and which corrects its second means no more because
    # its first step is long ago, is RMSprop, but with a fused kernel, which takes half the time.
    optimizer = _adam(weights, config, (0.0, config.rmsprop_decay))
    for weight in weights:
        optimizer.state[weight] = {
            "step": torch.tensor(_LONG_AGO, device=weight.device),
            "exp_avg": torch.zeros_like(weight),
            "exp_avg_sq": torch.zeros_like(weight),
        }
    return optimizer


def _adam(
    weights: list[nn.Parameter], config: LearningConfig, betas: tuple[float, float]
) -> torch.optim.Adam:
    # The fused kernel does the same arithmetic in one pass over memory.
    return torch.optim.Adam(
        weights, lr=config.learning_rate, betas=betas, eps=config.optimizer_epsilon, fused=True
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
