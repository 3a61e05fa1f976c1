"""The precision in which a network computes: its own float32, or a bfloat16 copy of it.

The small steps of an optimizer would vanish in bfloat16's 8 bits, so the master weights stay
float32, and a copy does the multiplying. The arithmetic is that of `torch.autocast`. But autocast
casts all weights in every pass, into new memory, which costs a third of an update.
"""

import copy

import torch
from torch import Tensor, nn

from common.network import QNetwork
from learner.device import Device


class Precision:
    """How a network with float32 master weights computes on ``device``."""

    def __init__(self, master: QNetwork, device: Device) -> None:
        self.dtype = torch.bfloat16 if device.bfloat16 else torch.float32
        """Type of the pixels that `network` takes."""
        self.network = _bfloat16_copy(master) if device.bfloat16 else master
        """The network to compute with."""
        self._is_copy = device.bfloat16
        self._masters: list[Tensor] = list(master.parameters())
        self._copies: list[Tensor] = list(self.network.parameters())
        if self._is_copy:
            # The copy must follow when a checkpoint or a sync of the target loads whole weights.
            master.register_load_state_dict_post_hook(  # type: ignore[no-untyped-call]
                lambda *_: self.sync_from_master()
            )

    def backward(self, loss: Tensor) -> None:
        """Computes the gradients of ``loss``, an output of `network`, for the master weights."""
        self.network.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        if self._is_copy:
            for master in self._masters:
                if master.grad is None:
                    master.grad = torch.zeros_like(master)
            torch._foreach_copy_(_gradients(self._masters), _gradients(self._copies))

    @torch.no_grad()
    def sync_from_master(self) -> None:
        """Copies the present master weights into `network`."""
        if self._is_copy:
            torch._foreach_copy_(self._copies, self._masters)


def _bfloat16_copy(master: QNetwork) -> QNetwork:
    copied = copy.deepcopy(master)
    first, *others = (m for m in copied.modules() if isinstance(m, nn.Conv2d | nn.Linear))
    for layer in others:
        layer.to(torch.bfloat16)
    # The first layer stays float32: it is scaled before it is rounded, see `QNetwork.forward`.
    assert first.weight.dtype == torch.float32
    return copied


def _gradients(parameters: list[Tensor]) -> list[Tensor]:
    return [p.grad for p in parameters if p.grad is not None]
