"""The quantile Huber loss by compiled code, `common/native/quantile_huber.cpp`."""

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from common.native.library import InstructionSet, library


def native_quantile_huber(
    instruction_set: InstructionSet, predicted: Tensor, targets: Tensor
) -> Tensor:
    """Returns what `learner.algorithm.qr_dqn.quantile_huber` does. The pairs of quantiles never lie
    in memory, which takes a small part of the time. Only ``predicted`` gets a gradient.

    Raises:
        ValueError: the two are not ``float32 [batch, N]`` and ``float32 [batch, N']``.
    """
    losses: Tensor = _QuantileHuber.apply(  # type: ignore[no-untyped-call]
        predicted, targets, instruction_set
    )
    return losses


class _QuantileHuber(torch.autograd.Function):
    """Losses and their gradients, which the code writes at once."""

    @staticmethod
    def forward(
        ctx: Any, predicted: Tensor, targets: Tensor, instruction_set: InstructionSet
    ) -> Tensor:
        if (
            {predicted.dtype, targets.dtype} != {torch.float32}
            or (predicted.dim(), targets.dim()) != (2, 2)
            or len(predicted) != len(targets)
        ):
            raise ValueError(
                f"not quantiles: {predicted.dtype} {tuple(predicted.shape)} and {targets.dtype} "
                f"{tuple(targets.shape)}"
            )
        predicted, targets = predicted.contiguous(), targets.contiguous()
        losses, gradients = predicted.new_empty(len(predicted)), torch.empty_like(predicted)
        library(instruction_set).quantile_huber(
            *(predicted.data_ptr(), targets.data_ptr(), *predicted.shape, targets.shape[1]),
            *(losses.data_ptr(), gradients.data_ptr(), torch.get_num_threads()),
        )
        ctx.save_for_backward(gradients)
        return losses

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, of_losses: Tensor) -> tuple[Tensor, None, None]:
        (gradients,) = ctx.saved_tensors
        return of_losses[:, None] * gradients, None, None
