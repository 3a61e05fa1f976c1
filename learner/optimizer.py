"""The optimizers of the presets."""

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
