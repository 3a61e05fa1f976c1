"""The optimizers, and the bound on their gradients."""

from collections.abc import Iterable, Mapping, Sequence

import torch
from torch import Tensor, nn
from torch.nn.utils import clip_grads_with_norm_, get_total_norm

from common.run.config import LearningConfig

_LONG_AGO = 1e9
"""Number of steps after which ρ^steps is 0."""
_MOMENTUM = 0.95
"""μ of Muon."""


class BoundedOptimizer:
    """The optimizer that ``config`` names, with a bound on the common norm of all gradients."""

    def __init__(self, parameters: Iterable[nn.Parameter], config: LearningConfig) -> None:
        self._parameters = list(parameters)
        self._optimizers = build_optimizers(self._parameters, config)
        self._config = config

    def set_rate(self, updates: int) -> None:
        """Sets the learning rate to its value after ``updates`` of the run."""
        rate = self._config.learning_rate_at(updates)
        for optimizer in self._optimizers:
            for group in optimizer.param_groups:
                if isinstance(group["lr"], Tensor):
                    group["lr"].fill_(rate)
                else:
                    group["lr"] = rate

    def step(self, loss: Tensor) -> None:
        """Moves the parameters by their gradients, unless the scalar ``loss`` is not finite."""
        if self._config.gradient_norm:
            clip_gradients(self._parameters, self._config.gradient_norm)
        # The optimizers themselves check this, so nothing waits for the device.
        found_inf = (~loss.isfinite()).float()
        for optimizer in self._optimizers:
            optimizer.found_inf = found_inf  # type: ignore[attr-defined]
            optimizer.step()

    def state(self) -> dict[str, Tensor]:
        """Returns the slots of each parameter as ``optimizer.INDEX.SLOT``."""
        return {
            f"optimizer.{index}.{slot}": torch.as_tensor(value)
            for index, weight in enumerate(self._parameters)
            for optimizer in self._optimizers
            for slot, value in optimizer.state.get(weight, {}).items()
        }

    def load_state(self, state: Mapping[str, Tensor]) -> None:
        """Restores the slots in ``state``, which may hold other tensors too."""
        slots: dict[nn.Parameter, dict[str, Tensor]] = {}
        for name, value in state.items():
            if name.startswith("optimizer."):
                _, index, slot = name.split(".")
                like = self._parameters[int(index)]
                if value.shape == like.shape:
                    # In the parameter's own memory layout, or the fused kernel would be slow.
                    value = torch.empty_like(like).copy_(value).detach()
                slots.setdefault(like, {})[slot] = value
        for optimizer in self._optimizers:
            weights = (weight for group in optimizer.param_groups for weight in group["params"])
            own = {place: slots[weight] for place, weight in enumerate(weights) if weight in slots}
            groups = optimizer.state_dict()["param_groups"]
            optimizer.load_state_dict({"state": own, "param_groups": groups})


def build_optimizers(
    parameters: Iterable[nn.Parameter], config: LearningConfig
) -> list[torch.optim.Optimizer]:
    """Returns the optimizers that share the parameters: Adam or RMSprop alone, or Muon for the
    weights of convolutions beside Adam for the rest."""
    weights = list(parameters)
    kernels = [each for each in weights if each.ndim == 4] if config.optimizer == "muon" else []
    if not kernels:
        return [_adam(weights, config)]
    others = [each for each in weights if each.ndim != 4]
    return [Muon(kernels, lr=_rate(kernels, config)), _adam(others, config)]


def _rate(weights: Sequence[nn.Parameter], config: LearningConfig) -> Tensor | float:
    """Returns the learning rate; on CUDA as a tensor, so that a CUDA graph reads the present rate
    at each step."""
    rate, device = config.learning_rate, weights[0].device
    return torch.tensor(rate, device=device) if device.type == "cuda" else rate


def _adam(weights: Sequence[nn.Parameter], config: LearningConfig) -> torch.optim.Optimizer:
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
    rmsprop = config.optimizer == "rmsprop"
    optimizer = torch.optim.Adam(
        weights,
        lr=_rate(weights, config),
        capturable=weights[0].is_cuda,
        betas=(0.0, config.rmsprop_decay) if rmsprop else (0.9, 0.999),
        eps=config.optimizer_epsilon,
        fused=True,  # the same arithmetic in one pass over memory
    )
    if not rmsprop:
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


class Muon(torch.optim.Optimizer):
    """Muon (Jordan et al. 2024) for the weights of convolutions, each as a matrix ``[out, in ·
    height · width]``.

    ``m ← μm + g;  w ← w - lr · 0.2 √(longer side) · orthogonal(g + μm)`` with μ = 0.95. The factor
    gives a step the root mean square of a usual one of Adam (Liu et al. 2025, equation 4).

    Most of a picture stands still, and so do the largest parts of a gradient. A step that is as
    long in all directions also follows the small ones, of what moves. `torch.optim.Muon` takes
    matrices only, computes in bfloat16, which older processors emulate, and knows no ``found_inf``.
    """

    found_inf: Tensor
    """1 if the gradients are not finite, so that `step` must change nothing; otherwise 0."""

    def __init__(self, weights: Iterable[nn.Parameter], lr: Tensor | float) -> None:
        super().__init__(weights, {"lr": lr})

    @torch.no_grad()
    def step(self, closure: None = None) -> None:  # type: ignore[override]
        finite = self.found_inf == 0
        for group in self.param_groups:
            for weight in group["params"]:
                state, gradient = self.state[weight], weight.grad
                if not state:
                    state["momentum"] = torch.zeros_like(weight)
                momentum = state["momentum"]
                new = _MOMENTUM * momentum + gradient
                matrix = (gradient + _MOMENTUM * new).flatten(1)
                step = orthogonal(matrix) * (0.2 * max(matrix.shape) ** 0.5 * group["lr"])
                # In place: a CUDA graph knows where they are.
                momentum.copy_(torch.where(finite, new, momentum))
                weight -= torch.where(finite, step.view(weight.shape), 0.0)


def orthogonal(matrix: Tensor) -> Tensor:
    """Returns the matrix of the same singular vectors whose singular values are near 1.

    Five iterations of Newton and Schulz with the coefficients of Jordan et al. 2024 bring values of
    0.01 to 1 times the Frobenius norm to between 0.68 and 1.14; smaller ones grow 480-fold at most.
    """
    if matrix.shape[0] > matrix.shape[1]:
        return orthogonal(matrix.T).T
    found: Tensor = matrix / (matrix.norm() + 1e-12)  # a gradient may be 0
    for _ in range(5):
        square = found @ found.T
        found = 3.4445 * found + (-4.7750 * square + 2.0315 * square @ square) @ found
    return found


def clip_gradients(parameters: Sequence[nn.Parameter], longest: float) -> None:
    """Scales all gradients so that their common norm is at most ``longest``.

    Like `torch.nn.utils.clip_grad_norm_`, which, however, also multiplies short gradients, by 1.
    """
    length = get_total_norm([p.grad for p in parameters if p.grad is not None], foreach=True)
    # On CUDA always: to compare the norm would wait for the device.
    if length.is_cuda or length > longest:
        clip_grads_with_norm_(parameters, longest, length, foreach=True)
