"""`NativeQNetwork`: a Q-network whose large layers are computed by `common/native/trunk.cpp`."""

import weakref
from collections.abc import Sequence
from ctypes import c_void_p
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import linear

from common.native.library import InstructionSet, library, multiplies_bfloat16
from common.network import QNetwork

_KERNELS = [((32, 4, 8, 8), (4, 4)), ((64, 32, 4, 4), (2, 2)), ((64, 64, 3, 3), (1, 1))]
"""Shapes of the convolutions' weights, and strides, for which the code is written."""
_FEATURES, _HIDDEN = 64 * 7 * 7, 512
_FRAMES = (4, 84, 84)
_FEW = 1_536
"""Number of outputs, over all states, up to which float32 is faster than converting the weights."""
_PIXELS = (21, 21, 64)
"""A state's pixels: blocks down and across, and the 4 × 4 pixels of each in all four frames."""


class _Kept(NamedTuple):
    """What a forward pass with gradients leaves for the backward pass."""

    pixels: Tensor
    units: Tensor
    """Outputs of the compiled code, which get a gradient."""
    vector_weight: Tensor
    """Weights of the vectors, which get one too."""


class NativeQNetwork(QNetwork):
    """Computes what ``master`` computes, from the same parameters: convolutions and dense layers in
    float32, or in bfloat16, all but the last one with sums in float32.

    The compiled code has its own copy of the weights: call `pack` when an optimizer has changed
    them. It keeps one forward pass with gradients, until `backward` takes it; PyTorch does further
    ones. Unlike a `QNetwork`, it computes for one thread at a time.
    """

    def __init__(self, master: QNetwork, instruction_set: InstructionSet) -> None:
        """Raises NativeUnavailableError as `library` does, and ValueError for a ``master`` whose
        weights the code cannot read: of other shapes, types or layouts."""
        if not self.fits(master):
            raise ValueError("not the layers that the native kernel is for")
        nn.Module.__init__(self)
        self.__dict__.update(vars(master))  # its layers themselves, no copies
        self._library = library(instruction_set)
        self.dtype = torch.bfloat16 if multiplies_bfloat16(instruction_set) else torch.float32
        """Type of the pixels that it takes."""
        self._trunk = c_void_p(self._library.trunk_new())
        free = weakref.finalize(self, self._library.trunk_free, self._trunk)
        free.atexit = False  # a thread may still compute with it then
        layers: list[nn.Conv2d | nn.Linear] = [*_convolutions(master), master.hidden]
        self._weights: list[Tensor] = [layer.weight for layer in layers]
        self._biases = [layer.bias for layer in layers if layer.bias is not None]
        for each in (*self._weights, *self._biases):
            layout = torch.channels_last if each.dim() == 4 else torch.contiguous_format
            if each.dtype != torch.float32 or not each.is_contiguous(memory_format=layout):
                raise ValueError(f"weights of {each.dtype} or in another layout")
        # Kept for all updates: 6 MB of new memory for each would cost more than the arithmetic.
        of_weights, of_biases = (
            [torch.zeros_like(each) for each in tensors]
            for tensors in (self._weights, self._biases)
        )
        self._gradients = [*of_weights, *of_biases]
        self._of_dense = of_weights[-1]
        # Looked up once: PyTorch's look-up is too slow to repeat in every update.
        self._parameters_at = addresses(self._weights), addresses(self._biases)
        self._gradients_at = addresses(of_weights), addresses(of_biases)
        self._kept: _Kept | None = None
        self.pack()
        # The hooks are those of ``master``, too.
        self.register_load_state_dict_post_hook(  # type: ignore[no-untyped-call]
            lambda *_: self.pack()
        )

    @staticmethod
    def fits(network: nn.Module) -> bool:
        """Returns whether the code is written for the layers of ``network``."""
        if type(network) is not QNetwork:
            return False
        kernels = [(tuple(m.weight.shape), m.stride) for m in _convolutions(network)]
        return kernels == _KERNELS and network.hidden.out_features == _HIDDEN

    @torch.no_grad()
    def pack(self) -> None:
        """Takes over the present weights."""
        self._library.trunk_pack(
            *(self._trunk, *self._parameters_at),
            *(self.hidden.in_features, self.pixel_scale, torch.get_num_threads()),
        )

    def as_pixels(self, frames: Tensor, dtype: torch.dtype | None = None) -> Tensor:
        """Returns ``frames`` as `hidden_units` takes them, ``[batch, 21, 21, 64]``, in its numbers.

        Raises:
            ValueError: they are not ``uint8 [batch, 4, 84, 84]``, or another type is asked for.
        """
        if (
            frames.dtype != torch.uint8
            or frames.shape[1:] != _FRAMES
            or dtype not in (None, self.dtype)
        ):
            raise ValueError(f"no pixels of {dtype} from {frames.dtype} {tuple(frames.shape)}")
        frames = frames.contiguous()
        pixels = torch.empty(len(frames), *_PIXELS, dtype=self.dtype)
        self._library.trunk_pixels(
            *(frames.data_ptr(), pixels.data_ptr(), len(frames)),
            *(self.frame_differences, self.center_pixels, torch.get_num_threads()),
        )
        return pixels

    def hidden_units(self, frames: Tensor, vectors: Tensor) -> Tensor:
        pixels = frames if frames.is_floating_point() else self.as_pixels(frames)
        if pixels.dtype != self.dtype or pixels.shape[1:] != _PIXELS:
            raise ValueError(f"not pixels: {pixels.dtype} {tuple(pixels.shape)}")
        if vectors.shape != (len(pixels), self.hidden.in_features - _FEATURES):
            raise ValueError(f"vectors of another shape: {tuple(vectors.shape)}")
        pixels = pixels.contiguous()
        differentiable = torch.is_grad_enabled()
        if differentiable and self._kept is not None:
            return super().hidden_units(_frames_of(pixels), vectors)
        units = torch.empty(len(pixels), _HIDDEN)
        self._library.trunk_forward(
            *(self._trunk, pixels.data_ptr(), len(pixels), differentiable),
            *(units.data_ptr(), torch.get_num_threads()),
        )
        weight = self.hidden.weight[:, _FEATURES:].detach()
        if differentiable:
            self._kept = _Kept(pixels, units.requires_grad_(), weight.requires_grad_())
        return units + linear(vectors, weight) if vectors.shape[1] else units

    def outputs(self, hidden: Tensor) -> Tensor:
        if self.dtype == torch.float32 or len(hidden) * self.actions.out_features <= _FEW:
            return super().outputs(hidden)
        weight, bias = self.actions.weight.bfloat16(), self.actions.bias.bfloat16()
        return linear(hidden.bfloat16(), weight, bias)

    @torch.no_grad()
    def backward(self) -> None:
        """Gives the layers of the compiled code their gradients, from that of the units; none if
        the loss did not depend on them. Those of an earlier update must have been taken away."""
        kept, self._kept = self._kept, None
        if kept is None or kept.units.grad is None:
            return
        of_units = kept.units.grad.contiguous()
        self._library.trunk_backward(
            *(self._trunk, kept.pixels.data_ptr(), len(of_units), of_units.data_ptr()),
            *self._gradients_at,
            *(self.hidden.in_features, torch.get_num_threads()),
        )
        if kept.vector_weight.grad is not None:
            self._of_dense[:, _FEATURES:] = kept.vector_weight.grad
        for parameter, gradient in zip(
            (*self._weights, *self._biases), self._gradients, strict=True
        ):
            if parameter.grad is None:
                parameter.grad = gradient
            else:  # of a further forward pass
                parameter.grad += gradient


def _convolutions(network: QNetwork) -> list[nn.Conv2d]:
    return [layer for layer in network.convolutions if isinstance(layer, nn.Conv2d)]


def _frames_of(pixels: Tensor) -> Tensor:
    """Returns pixels as `QNetwork` takes them, ``float32 [batch, 4, 84, 84]``."""
    blocks = pixels.float().reshape(-1, 21, 21, 4, 4, 4)
    return blocks.permute(0, 3, 1, 4, 2, 5).reshape(-1, *_FRAMES)


def addresses(tensors: Sequence[Tensor]) -> object:
    """Returns the addresses of ``tensors`` as C takes them, which must neither be freed nor move
    while these are in use."""
    return (c_void_p * len(tensors))(*(each.data_ptr() for each in tensors))
