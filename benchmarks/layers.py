"""How near the layers of a network come to the best rate of the processor.

A convolution is a product of two matrices, its unfolded input and its weights; so is a dense layer.
The best rate is that of the fastest of these products, as one call of PyTorch's. Each layer is
timed alone, with its input in cache, so an update takes longer than the sum.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from benchmarks.pace import in_turns
from common.native.library import InstructionSet
from common.native.network import NativeQNetwork
from common.network import QNetwork
from common.protocol.step_fields import FRAME_SHAPE

_FORWARD_PASSES = 3
"""Forward passes of a Double DQN update: the online network evaluates s and s′, and the target
network evaluates s′. A backward pass follows only for s."""


class Layer(NamedTuple):
    """A layer with weights, and an input as it has in its network."""

    name: str
    module: nn.Conv2d | nn.Linear
    input: Tensor
    """The first layer's needs no gradient; the others' do."""
    product: tuple[int, int, int]
    """Rows, inner size and columns of the product of matrices that the layer is."""

    @property
    def multiplications(self) -> int:
        return int(np.prod(self.product))

    @property
    def of_an_update(self) -> int:
        """Multiplications in an update; each gradient takes as many as a forward pass."""
        gradients = 2 if self.input.requires_grad else 1
        return (_FORWARD_PASSES + gradients) * self.multiplications


def layers_of(network: QNetwork, batch_size: int, dtype: torch.dtype) -> Iterator[Layer]:
    """Yields the layers of ``network``, which has no vector, for states of noise."""
    stack = network.convolutions[0].in_channels
    assert isinstance(stack, int)
    frames = torch.randint(0, 256, (batch_size, stack, *FRAME_SHAPE), dtype=torch.uint8)
    given = network.as_pixels(frames, dtype)
    for module in network.modules():
        if not isinstance(module, (nn.Conv2d, nn.Linear)):
            continue
        module.to(dtype)
        dense = isinstance(module, nn.Linear)
        given = given.flatten(1) if dense else given
        result = module(given).detach()
        outputs, *inner = module.weight.shape
        name = f"{'dense' if dense else 'convolution'} {'×'.join(map(str, (*inner, outputs)))}"
        product = (result.numel() // outputs, int(np.prod(inner)), outputs)
        yield Layer(name, module, given, product)
        given = result.relu().requires_grad_()


def time_layers(layers: Sequence[Layer], turns: int) -> list[dict[str, Any]]:
    """Returns a row for each layer, and a last one for all, with their multiplications in an
    update, and the rate of the layer's own product of matrices; the last row has the best one."""
    works = {
        (layer.name, kind): partial(_seconds, work)
        for layer in layers
        for kind, work in _works(layer).items()
    }
    seconds = {name: float(np.median(each)) for name, each in in_turns(works, turns).items()}
    rows = []
    for layer in layers:
        forward, backward, product = (
            seconds[layer.name, kind] for kind in ("forward", "backward", "product")
        )
        update = _FORWARD_PASSES * forward + backward
        rows.append(
            _row(layer.name, layer.of_an_update, update, layer.multiplications / product / 1e9)
        )
    best = max(row["one product, per ns"] for row in rows)
    total = sum(layer.of_an_update for layer in layers)
    return [*rows, _row("all", total, sum(row["ms"] for row in rows) / 1e3, best)]


def time_native(
    network: QNetwork, instruction_set: InstructionSet, batch_size: int, turns: int
) -> list[dict[str, Any]]:
    """Returns a row for each part of `NativeQNetwork`, alone, with its multiplications in an
    update: none where it only arranges."""
    native = NativeQNetwork(network, instruction_set)
    frames = torch.randint(0, 256, (batch_size, 4, *FRAME_SHAPE), dtype=torch.uint8)
    pixels, vectors = native.as_pixels(frames), torch.zeros(batch_size, 0)
    known = (native.hidden, *native.convolutions)
    layers = [
        each for each in layers_of(network, batch_size, torch.float32) if each.module in known
    ]
    forward = sum(layer.multiplications for layer in layers)
    backward = sum(layer.of_an_update for layer in layers) - _FORWARD_PASSES * forward

    def pass_forward() -> None:
        with torch.no_grad():
            native.hidden_units(pixels, vectors)

    def pass_both_ways() -> None:
        native.hidden_units(pixels, vectors).sum().backward()  # type: ignore[no-untyped-call]
        native.backward()

    works: dict[str, Callable[[], object]] = {
        "pixels, of s and s′": lambda: native.as_pixels(frames),
        "weights": native.pack,
        "forward, three times": pass_forward,
        "backward": pass_both_ways,
    }
    timed = in_turns({name: partial(_seconds, work) for name, work in works.items()}, turns)
    seconds = {name: float(np.median(each)) for name, each in timed.items()}
    seconds["backward"] -= seconds["forward, three times"]
    seconds["pixels, of s and s′"] *= 2
    seconds["forward, three times"] *= _FORWARD_PASSES
    million = {"forward, three times": _FORWARD_PASSES * forward, "backward": backward}
    return [
        {
            "part": name,
            "million": million[name] / 1e6 if name in million else "–",
            "ms": each * 1e3,
            "per ns": million[name] / each / 1e9 if name in million else "–",
        }
        for name, each in seconds.items()
    ]


def _row(name: str, multiplications: int, seconds: float, product: float) -> dict[str, Any]:
    return {
        "layer": name,
        "million": multiplications / 1e6,
        "ms": seconds * 1e3,
        "per ns": multiplications / seconds / 1e9,
        "one product, per ns": product,
    }


def _works(layer: Layer) -> dict[str, Callable[[], object]]:
    """Returns what is timed of a layer, by kind."""
    rows, inner, columns = layer.product
    left = torch.randn(rows, inner).to(layer.input.dtype)
    right = torch.randn(inner, columns).to(layer.input.dtype)
    result = layer.module(layer.input)
    wanted = [*layer.module.parameters(), *([layer.input] if layer.input.requires_grad else [])]

    def forward() -> object:
        with torch.no_grad():
            return layer.module(layer.input)

    gradient = torch.randn_like(result)
    return {
        "forward": forward,
        "backward": partial(torch.autograd.grad, result, wanted, gradient, retain_graph=True),
        "product": partial(torch.mm, left, right),
    }


def _seconds(work: Callable[[], object]) -> float:
    work()  # what it reads is in cache afterwards
    began = time.perf_counter()
    work()
    return time.perf_counter() - began
