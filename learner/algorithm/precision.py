"""The arithmetic of a network: float32, bfloat16 from a copy of the weights, or compiled code.

The small steps of an optimizer would vanish in bfloat16's 8 bits, so the master weights stay
float32, and a copy does the multiplying. The arithmetic is that of `torch.autocast`. But autocast
casts all weights in every pass, into new memory, which costs a third of an update.
"""

import copy
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from common.native.library import InstructionSet
from common.native.network import NativeQNetwork
from common.network import QNetwork
from learner.device import Device


def precision_of(master: QNetwork, device: Device) -> "Precision":
    """Returns how ``master`` computes on ``device``: by the compiled code if that is chosen and
    knows its layers."""
    if device.native and NativeQNetwork.fits(master):
        return NativePrecision(master, device.native)
    return Bfloat16Precision(master) if device.bfloat16 else Precision(master)


class Precision:
    """Computes in float32, with the master weights themselves."""

    dtype: torch.dtype = torch.float32
    """Type of the pixels that `network` takes."""

    def __init__(self, master: QNetwork) -> None:
        self.network: QNetwork = master
        """The network to compute with."""
        self._parameters: list[Tensor] = list(self.network.parameters())

    def as_pixels(self, frames: Tensor) -> Tensor:
        """Returns uint8 frames as `network` takes them, see `QNetwork.as_pixels`."""
        return self.network.as_pixels(frames, self.dtype)

    def backward(self, loss: Tensor) -> None:
        """Computes the gradients of ``loss``, an output of `network`, for the master weights."""
        for parameter in self._parameters:  # `zero_grad` looks for them in every module
            parameter.grad = None
        loss.backward()  # type: ignore[no-untyped-call]

    def sync_from_master(self) -> None:
        """Takes over the present master weights."""


class Bfloat16Precision(Precision):
    """Computes in bfloat16, with a copy of the weights."""

    dtype = torch.bfloat16

    def __init__(self, master: QNetwork) -> None:
        super().__init__(_bfloat16_copy(master))
        self._masters: list[Tensor] = list(master.parameters())
        # The copy must follow when a checkpoint or a sync of the target loads whole weights.
        master.register_load_state_dict_post_hook(  # type: ignore[no-untyped-call]
            lambda *_: self.sync_from_master()
        )

    def backward(self, loss: Tensor) -> None:
        super().backward(loss)
        for master in self._masters:
            if master.grad is None:
                master.grad = torch.zeros_like(master)
        torch._foreach_copy_(_gradients(self._masters), _gradients(self._parameters))

    @torch.no_grad()
    def sync_from_master(self) -> None:
        torch._foreach_copy_(self._parameters, self._masters)


class NativePrecision(Precision):
    """Computes the large layers by compiled code, see `NativeQNetwork`."""

    def __init__(self, master: QNetwork, instruction_set: InstructionSet) -> None:
        self._native = NativeQNetwork(master, instruction_set)
        self.dtype = self._native.dtype
        super().__init__(self._native)

    def backward(self, loss: Tensor) -> None:
        super().backward(loss)
        self._native.backward()

    def sync_from_master(self) -> None:
        self._native.pack()


def _bfloat16_copy(master: QNetwork) -> QNetwork:
    copied = copy.deepcopy(master)
    first, *others = (m for m in copied.modules() if isinstance(m, nn.Conv2d | nn.Linear))
    for layer in others:
        layer.to(torch.bfloat16)
    # The first layer stays float32: it is scaled before it is rounded, see `QNetwork.forward`.
    assert first.weight.dtype == torch.float32
    return copied


def _gradients(parameters: Sequence[Tensor]) -> list[Tensor]:
    return [p.grad for p in parameters if p.grad is not None]
