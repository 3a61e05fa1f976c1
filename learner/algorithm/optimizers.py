"""The optimizers of the presets, and the bound on their gradients."""

from collections.abc import Iterable, Mapping, Sequence

import torch
from torch import Tensor, nn
from torch.nn.utils import clip_grads_with_norm_, get_total_norm

from common.run.config import LearningConfig

_LONG_AGO = 1e9
"""Number of steps after which ρ^steps is 0."""


class BoundedOptimizer:
    """The optimizer that ``config`` names, with a bound on the common norm of all gradients."""

    def __init__(self, parameters: Iterable[nn.Parameter], config: LearningConfig) -> None:
        self._parameters = list(parameters)
        self._optimizer = build_optimizer(self._parameters, config)
        self._config = config

    def set_rate(self, updates: int) -> None:
        """Sets the learning rate to its value after ``updates`` of the run."""
        for group in self._optimizer.param_groups:
            rate = self._config.learning_rate_at(updates)
            if isinstance(group["lr"], Tensor):
                group["lr"].fill_(rate)
            else:
                group["lr"] = rate

    def step(self, loss: Tensor) -> None:
        """Moves the parameters by their gradients, unless the scalar ``loss`` is not finite."""
        if self._config.gradient_norm:
            clip_gradients(self._parameters, self._config.gradient_norm)
        # The kernel itself checks this, so nothing waits for the device.
        self._optimizer.found_inf = (~loss.isfinite()).float()  # type: ignore[attr-defined]
        self._optimizer.step()

    def state(self) -> dict[str, Tensor]:
        """Returns the slots of each parameter as ``optimizer.INDEX.SLOT``."""
        return {
            f"optimizer.{index}.{slot}": torch.as_tensor(value)
            for index, slots in self._optimizer.state_dict()["state"].items()
            for slot, value in slots.items()
        }

    def load_state(self, state: Mapping[str, Tensor]) -> None:
        """Restores the slots in ``state``, which may hold other tensors too."""
        slots: dict[int, dict[str, Tensor]] = {}
        for name, value in state.items():
            if name.startswith("optimizer."):
                _, index, slot = name.split(".")
                like = self._parameters[int(index)]
                if value.shape == like.shape:
                    # In the parameter's own memory layout, or the fused kernel would be slow.
                    value = torch.empty_like(like).copy_(value).detach()
                slots.setdefault(int(index), {})[slot] = value
        groups = self._optimizer.state_dict()["param_groups"]
        self._optimizer.load_state_dict({"state": slots, "param_groups": groups})


def build_optimizer(
    parameters: Iterable[nn.Parameter], config: LearningConfig
) -> torch.optim.Optimizer:
    """Returns Adam, or the RMSprop of Keras in 2017, which is also that of PyTorch.

    Keras and PyTorch: ``v ← ρv + (1-ρ)g²;  w ← w - lr·g / (√v + ε)`` from v = 0. TensorFlow 1 has
    ``√(v + ε)`` from v = 1 instead, and Mnih et al. 2015 the centred variant; the code of 2017 used
    neither.

    RMSprop runs on Adam's fused kernel. PyTorch has no fused kernel for RMSprop, and makes five
    passes over the weights: 5.0 ms of processor time per step instead of 2.1 ms. With the fused
    kernel a whole run of preset ``paper`` on two cores made 69.4 updates/s instead of 60.4
    (benchmarks/LOG.md). After 1,000 steps the weights equal those of `torch.optim.RMSprop` to 4e-7
    of the distance that they moved.
    """
    weights, adam = list(parameters), config.optimizer == "adam"
    rate, cuda = config.learning_rate, weights[0].is_cuda
    optimizer = torch.optim.Adam(
        weights,
        # A tensor, so that a CUDA graph reads the present rate at each step.
        lr=torch.tensor(rate, device=weights[0].device) if cuda else rate,
        capturable=cuda,
        betas=(0.9, 0.999) if adam else (0.0, config.rmsprop_decay),
        eps=config.optimizer_epsilon,
        fused=True,  # the same arithmetic in one pass over memory
    )
    if adam:
        return optimizer
    # Adam is RMSprop if β1 is 0, so that gradients are their own means, and if its first step is
    # long ago, so that it no longer corrects its second means.
    for weight in weights:
        optimizer.state[weight] = {
            "step": torch.tensor(_LONG_AGO, device=weight.device),
            "exp_avg": torch.zeros_like(weight),
            "exp_avg_sq": torch.zeros_like(weight),
        }
    return optimizer


def clip_gradients(parameters: Sequence[nn.Parameter], longest: float) -> None:
    """Scales all gradients so that their common norm is at most ``longest``.

    Like `torch.nn.utils.clip_grad_norm_`, which, however, also multiplies short gradients, by 1.
    """
    length = get_total_norm([p.grad for p in parameters if p.grad is not None], foreach=True)
    # On CUDA always: to compare the norm would wait for the device.
    if length.is_cuda or length > longest:
        clip_grads_with_norm_(parameters, longest, length, foreach=True)
