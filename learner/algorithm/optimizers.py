"""The optimizers of the presets, and the bound on their gradients."""

import math
from collections.abc import Iterable, Mapping, Sequence
from ctypes import CDLL, c_long
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.utils import clip_grads_with_norm_, get_total_norm

from common.native.library import InstructionSet, library
from common.native.network import addresses
from common.settings.config import LearningConfig

_LONG_AGO = 1e9
"""Number of steps after which ρ^steps is 0."""


class BoundedOptimizer:
    """The optimizer that ``config`` names, with a bound on the common norm of all gradients."""

    def __init__(
        self,
        parameters: Iterable[nn.Parameter],
        config: LearningConfig,
        native: InstructionSet | None = None,
    ) -> None:
        """Builds the optimizer, for parameters without gaps in memory; its arithmetic is PyTorch's,
        or that of the compiled code."""
        self._parameters = list(parameters)
        self._optimizer = build_optimizer(self._parameters, config)
        self._config = config
        fits = all(weight.dtype == torch.float32 for weight in self._parameters)
        self._library = library(native) if native and fits else None
        self._compiled: _CompiledStep | None = None
        """The step by the present slots; None before it."""
        self._uneven = False
        """Whether a weight has taken fewer steps than another, so that PyTorch has to take them."""

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
        for weight in self._parameters:
            if weight.grad is not None and weight.grad.stride() != weight.stride():
                # Either kernel, PyTorch's too, would read it in the parameter's layout.
                weight.grad = torch.empty_like(weight).copy_(weight.grad).detach()
        if compiled := self._compiled_step():
            if math.isfinite(loss.item()):
                compiled(self._optimizer.param_groups[0], self._config.gradient_norm)
            return
        if self._config.gradient_norm:
            clip_gradients(self._parameters, self._config.gradient_norm)
        # The kernel itself checks this, so nothing waits for the device.
        self._optimizer.found_inf = (~loss.isfinite()).float()  # type: ignore[attr-defined]
        self._optimizer.step()

    def _compiled_step(self) -> "_CompiledStep | None":
        """Returns the step by compiled code, or None where PyTorch has to take it."""
        self._uneven |= any(weight.grad is None for weight in self._parameters)
        if self._library is None or self._uneven:
            return None
        if self._compiled is None:
            slots = [self._slots(weight) for weight in self._parameters]
            self._compiled = _CompiledStep(self._library, self._parameters, slots)
        return self._compiled

    def _slots(self, weight: nn.Parameter) -> dict[str, Tensor]:
        """Returns what the optimizer keeps of ``weight``; PyTorch makes it with its first step."""
        slots: dict[str, Tensor] = self._optimizer.state[weight]
        if not slots:
            slots |= new_slots(weight, steps=0)
        return slots

    def state(self) -> dict[str, Tensor]:
        """Returns the slots of each parameter as ``optimizer.INDEX.SLOT``."""
        return {
            f"optimizer.{index}.{slot}": torch.as_tensor(value)
            for index, slots in self._optimizer.state_dict()["state"].items()
            for slot, value in slots.items()
        }

    def load_state(self, state: Mapping[str, Tensor]) -> None:
        """Restores the slots in ``state``, which may hold other tensors too. Raises ValueError if
        they are not those of these parameters."""
        slots: dict[int, dict[str, Tensor]] = {}
        known = set()
        for index, weight in enumerate(self._parameters):
            like = new_slots(weight, steps=0)
            names = {slot: f"optimizer.{index}.{slot}" for slot in like}
            known |= {*names.values()}
            if not any(name in state for name in names.values()):
                continue  # before the first step
            for slot, name in names.items():
                if name not in state or state[name].shape != like[slot].shape:
                    raise ValueError(f"its {name} is missing, or of another shape")
                # In the parameter's own memory layout, or the step would be slow.
                like[slot].copy_(state[name])
            if not 0 <= float(like["step"]) < math.inf:
                raise ValueError(f"its {names['step']} is {float(like['step']):g}")
            slots[index] = like
        if more := {name for name in state if name.startswith("optimizer.")} - known:
            raise ValueError(f"its {min(more)} is of no parameter")
        groups = self._optimizer.state_dict()["param_groups"]
        self._optimizer.load_state_dict({"state": slots, "param_groups": groups})
        self._compiled = None  # it writes to the slots of before
        steps = {float(each["step"]) for each in slots.values()}
        self._uneven = len(steps) > 1 or len(slots) not in (0, len(self._parameters))


class _CompiledStep:
    """What PyTorch's optimizer does, in one pass over memory (``adam.cpp``)."""

    def __init__(
        self, code: CDLL, weights: Sequence[nn.Parameter], slots: Sequence[dict[str, Tensor]]
    ) -> None:
        self._code = code
        self._weights = weights
        self._slots = slots  # so that they outlive the step, which has their addresses
        names = "exp_avg", "exp_avg_sq", "step"
        self._weights_at = addresses(weights)
        self._slots_at = [addresses([each[name] for each in slots]) for name in names]
        self._sizes = (c_long * len(weights))(*(weight.numel() for weight in weights))

    def __call__(self, group: Mapping[str, Any], max_norm: float) -> None:
        """Moves all weights by their gradients, with the settings of ``group``."""
        gradients = [weight.grad for weight in self._weights if weight.grad is not None]
        assert len(gradients) == len(self._weights)
        self._code.adam_step(
            *(self._weights_at, addresses(gradients), *self._slots_at, self._sizes),
            *(len(self._weights), max_norm, group["lr"], *group["betas"], group["eps"]),
            torch.get_num_threads(),
        )


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
        optimizer.state[weight] = new_slots(weight, _LONG_AGO)
    return optimizer


def new_slots(weight: Tensor, steps: float) -> dict[str, Tensor]:
    """Returns what Adam keeps of ``weight``, by PyTorch's names, as after ``steps`` without
    gradients."""
    return {
        "step": torch.tensor(float(steps), device=weight.device),
        "exp_avg": torch.zeros_like(weight),
        "exp_avg_sq": torch.zeros_like(weight),
    }


def clip_gradients(parameters: Sequence[nn.Parameter], longest: float) -> None:
    """Scales all gradients so that their common norm is at most ``longest``.

    Like `torch.nn.utils.clip_grad_norm_`, which, however, also multiplies short gradients, by 1.
    """
    length = get_total_norm([p.grad for p in parameters if p.grad is not None], foreach=True)
    # On CUDA always: to compare the norm would wait for the device.
    if length.is_cuda or length > longest:
        clip_grads_with_norm_(parameters, longest, length, foreach=True)
