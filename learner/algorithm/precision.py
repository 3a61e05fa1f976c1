"""In which precision a network computes: its own float32, or a bfloat16 copy of it.

The small steps of an optimizer would vanish in bfloat16's 8 bits, so the master weights stay
float32 and a copy does the multiplying. The arithmetic is that of `torch.autocast`; but autocast
casts all weights anew in every pass, into fresh memory, which costs a third of an update.
"""

import copy
from typing import Generic, Protocol, TypeVar

import torch
from torch import Tensor, nn

from common.network import QNetwork
from learner.device import Device

Network = TypeVar("Network", bound=QNetwork)
AnyNetwork = TypeVar("AnyNetwork", bound=QNetwork, covariant=True)


class Precision(Protocol[AnyNetwork]):
    """How a network with float32 master weights computes."""

    @property
    def network(self) -> AnyNetwork:
        """The network to compute with."""

    @property
    def dtype(self) -> torch.dtype:
        """The type of the pixels that it takes."""

    def backward(self, loss: Tensor) -> None:
        """Let the master weights' gradients be those of ``loss``, which `network` computed."""

    def sync_from_master(self) -> None:
        """Let `network` have the master weights as they are now."""


class Float32(Generic[Network]):
    """Computes with the master weights themselves."""

    dtype = torch.float32

    def __init__(self, master: Network) -> None:
        self.network = master

    def backward(self, loss: Tensor) -> None:
        self.network.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]

    def sync_from_master(self) -> None:
        """Nothing to do."""


class Bfloat16(Generic[Network]):
    """Computes with a bfloat16 copy of the master weights."""

    dtype = torch.bfloat16

    def __init__(self, master: Network) -> None:
        self.network = copy.deepcopy(master)
        first, *others = (m for m in self.network.modules() if isinstance(m, nn.Conv2d | nn.Linear))
        for layer in others:
            layer.to(torch.bfloat16)
        # The first layer is scaled before it is rounded, see `QNetwork.forward`.
        assert first.weight.dtype == torch.float32
        self._masters: list[Tensor] = list(master.parameters())
        self._copies: list[Tensor] = list(self.network.parameters())
        # Whatever writes whole weights, a checkpoint or a sync of the target, reaches the copy.
        master.register_load_state_dict_post_hook(  # type: ignore[no-untyped-call]
            lambda *_: self.sync_from_master()
        )

    def backward(self, loss: Tensor) -> None:
        loss.backward()  # type: ignore[no-untyped-call]
        self._copy_gradients_to_master()

    @torch.no_grad()
    def sync_from_master(self) -> None:
        torch._foreach_copy_(self._copies, self._masters)

    @torch.no_grad()
    def _copy_gradients_to_master(self) -> None:
        """Move the gradients of a backward pass from the copy to the master weights."""
        for master in self._masters:
            if master.grad is None:
                master.grad = torch.zeros_like(master)
        torch._foreach_copy_(_gradients(self._masters), _gradients(self._copies))
        for copied in self._copies:
            copied.grad = None


def build_precision(master: Network, device: Device) -> Precision[Network]:
    """Returns the precision that ``device`` computes in, for a network that stands on it."""
    return Bfloat16(master) if device.bfloat16 else Float32(master)


def _gradients(parameters: list[Tensor]) -> list[Tensor]:
    return [p.grad for p in parameters if p.grad is not None]
