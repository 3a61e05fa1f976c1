"""A network computed in bfloat16 while its weights stay float32.

The small steps of an optimizer would vanish in bfloat16's 8 bits, so the original keeps float32
weights and a copy does the multiplying. The arithmetic is that of `torch.autocast`; but autocast
casts all weights anew in every pass, into fresh memory, which costs a third of an update.
"""

import copy

import torch
from torch import Tensor, nn

from common.network import QNetwork


class HalfPrecision:
    """The bfloat16 copy of ``original``, and the traffic between the two."""

    def __init__(self, original: QNetwork) -> None:
        self.network = copy.deepcopy(original)
        first, *others = (m for m in self.network.modules() if isinstance(m, nn.Conv2d | nn.Linear))
        for layer in others:
            layer.to(torch.bfloat16)
        # The first layer is scaled before it is rounded, see `QNetwork.forward`.
        assert first.weight.dtype == torch.float32
        self._originals: list[Tensor] = list(original.parameters())
        self._copies: list[Tensor] = list(self.network.parameters())
        # Whatever writes whole weights, a checkpoint or a copy of the target, is followed at once.
        original.register_load_state_dict_post_hook(  # type: ignore[no-untyped-call]
            lambda *_: self.follow()
        )

    @torch.no_grad()
    def follow(self) -> None:
        """Take over the original's weights, rounded."""
        torch._foreach_copy_(self._copies, self._originals)

    @torch.no_grad()
    def hand_back_gradients(self) -> None:
        """Give the original the gradients that a backward pass left here, and forget them."""
        for original in self._originals:
            if original.grad is None:
                original.grad = torch.zeros_like(original)
        torch._foreach_copy_(_gradients(self._originals), _gradients(self._copies))
        for copied in self._copies:
            copied.grad = None


def _gradients(parameters: list[Tensor]) -> list[Tensor]:
    return [p.grad for p in parameters if p.grad is not None]
