"""The networks of the algorithms, which learner and actors share.

They are those of Mnih et al. 2015 and 2013, with one or several outputs per action, such as
quantiles of its return. The module is not with the learner, so that an actor can play without the
training code.
"""

from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d, relu

from common.errors import InputError
from common.protocol.step_fields import FRAME_SHAPE
from common.registry import ALGORITHMS, foreign, resolve
from common.settings.config import InitialWeights, LearningConfig, NetworkName, RunConfig


class Layers(NamedTuple):
    """Sizes of a network's layers between its states and its actions."""

    convolutions: tuple[tuple[int, int, int], ...]
    """Channels, kernel and stride of each convolution; kernels and strides are square."""
    hidden: int
    """Units of the first dense layer."""


LAYERS: dict[NetworkName, Layers] = {
    "nature": Layers(((32, 8, 4), (64, 4, 2), (64, 3, 1)), 512),  # Mnih et al. 2015, and 2017
    "nips": Layers(((16, 8, 4), (32, 4, 2)), 256),  # Mnih et al. 2013; a third of the arithmetic
}


_USUAL = LearningConfig()


class QNetwork(nn.Module):
    """Convolutions and two dense layers: state → value of each action.

    Args:
        learning: settings of the layers, of the pixels' scaling, and of the initial weights.
        atoms: number of outputs per action; their mean is the action's value.
    """

    def __init__(
        self,
        actions: int,
        frame_stack: int = 4,
        vector_width: int = 0,
        learning: LearningConfig = _USUAL,
        *,
        atoms: int = 1,
    ) -> None:
        super().__init__()
        self.action_count = actions
        # Centred pixels have a standard deviation of about 64 grey levels.
        scale = 1 / 64 if learning.center_pixels else 1 / 255
        self.pixel_scale = scale if learning.scale_pixels else 1.0
        self.center_pixels = learning.center_pixels
        self.frame_differences = learning.frame_differences
        layers = LAYERS[learning.network]
        convolutions: list[nn.Module] = []
        channels, side = frame_stack, FRAME_SHAPE[0]
        for filters, kernel, stride in layers.convolutions:
            convolutions += (nn.Conv2d(channels, filters, kernel, stride), nn.ReLU())
            channels, side = filters, (side - kernel) // stride + 1
        self.convolutions = nn.Sequential(*convolutions)
        self.hidden = nn.Linear(channels * side * side + vector_width, layers.hidden)
        self.norm = nn.LayerNorm(layers.hidden) if learning.layer_norm else None
        self.actions = nn.Linear(layers.hidden, actions * atoms)
        self._initialise(learning.initial_weights)
        # Channels last is the layout in which convolutions on CPU and GPU are fastest.
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def _initialise(self, kind: InitialWeights) -> None:
        """Draws the initial weights.

        PyTorch's have a sixth of the variance of He's, so only a two-hundredth of the differences
        between pictures reaches the last layer, and as little of the errors reaches the first.
        He's preserve the size of both (He et al. 2015). Those of the last layer are then a tenth,
        for initial values near 0.
        """
        if kind == "torch":
            return
        for layer in self.modules():
            if isinstance(layer, (nn.Conv2d, nn.Linear)):
                if kind == "glorot":
                    nn.init.xavier_uniform_(layer.weight)
                else:
                    nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
                nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
        if kind == "he":
            with torch.no_grad():
                self.actions.weight *= 0.1

    def as_pixels(self, frames: Tensor, dtype: torch.dtype = torch.float32) -> Tensor:
        """Returns uint8 frames in the type and memory layout that the first convolution needs.

        A caller that puts the same frames through two networks converts them once.

        Args:
            frames: ``uint8 [batch, frame_stack, height, width]``.
            dtype: type of the result; even bfloat16 represents its values, -255 to 255, exactly.
        """
        pixels = torch.empty_like(frames, dtype=dtype, memory_format=torch.channels_last)
        pairs = zip(pixels.unbind(1), frames.unbind(1), strict=True)
        # One frame at a time: PyTorch's conversion of all with a change of layout takes twice as
        # long, and differences within the new layout four times (benchmarks/LOG.md).
        if self.frame_differences:
            before = self._grey(frames[:, :1], dtype)  # the oldest frame's is its mean
            for converted, original in pairs:
                frame = original.to(dtype)
                converted.copy_(frame - before)
                before = frame
        else:
            for converted, original in pairs:
                converted.copy_(original)
            if self.center_pixels:
                pixels -= self._grey(frames, dtype).unsqueeze(1)
        return pixels

    def _grey(self, frames: Tensor, dtype: torch.dtype) -> Tensor:
        """Returns what is subtracted from the pixels of each state, ``[batch, 1, 1]``: the mean
        over its ``frames``, or 0 if pixels are not centred."""
        if not self.center_pixels:
            return torch.zeros(len(frames), 1, 1, dtype=dtype, device=frames.device)
        return frames.flatten(1).float().mean(dim=1).round().to(dtype).view(-1, 1, 1)

    def forward(self, frames: Tensor, vectors: Tensor) -> Tensor:
        """Returns Q-values, ``float32 [batch, actions]``.

        Args:
            frames: ``uint8 [batch, frame_stack, 84, 84]``, newest last; or the result of
                `as_pixels`, whose precision all layers then use.
            vectors: ``float32 [batch, P]``; P may be 0.
        """
        atoms = self.atoms(frames, vectors)
        return atoms.squeeze(2) if atoms.shape[2] == 1 else atoms.mean(dim=2)

    def atoms(self, frames: Tensor, vectors: Tensor) -> Tensor:
        """Returns the last layer's outputs, ``float32 [batch, actions, atoms]``."""
        hidden = self.hidden_units(frames, vectors)
        if self.norm is not None:  # in float32, whatever the precision of the layers
            hidden = self.norm(hidden.float()).to(hidden.dtype)
        numbers = self.outputs(relu(hidden)).float()
        return numbers.view(len(numbers), self.action_count, -1)

    def outputs(self, hidden: Tensor) -> Tensor:
        """Returns the last layer's outputs, ``[batch, actions × atoms]``."""
        numbers: Tensor = self.actions(hidden)
        return numbers

    def hidden_units(self, frames: Tensor, vectors: Tensor) -> Tensor:
        """Returns the first dense layer's outputs, ``[batch, hidden]``, before their ReLU."""
        units: Tensor = self.hidden(self._features(frames, vectors))
        return units

    def _features(self, frames: Tensor, vectors: Tensor) -> Tensor:
        """Returns the input of the first dense layer, ``[batch, features]``."""
        pixels = frames if frames.is_floating_point() else self.as_pixels(frames)
        first, *others = self.convolutions
        assert isinstance(first, nn.Conv2d)
        # Scaling the first layer's few weights gives the same result as scaling a million pixels.
        weight = (first.weight * self.pixel_scale).to(pixels.dtype)
        bias = None if first.bias is None else first.bias.to(pixels.dtype)
        features = conv2d(pixels, weight, bias, first.stride)
        for layer in others:
            features = layer(features)
        features = features.flatten(1)
        if vectors.shape[1]:
            features = torch.cat((features, vectors.to(features.dtype)), dim=1)
        return features


def build_network(config: RunConfig, actions: int, *, vector_width: int | None = None) -> QNetwork:
    """Returns the run's network with its initial weights, which are the same in every process of
    the run. ``vector_width`` overrides the width of the run's vector observation. Raises
    InputError if the network, of another package, cannot be made or gives no such outputs."""
    kind = ALGORITHMS.find(config.learning.algorithm)
    width = config.vector_width if vector_width is None else vector_width
    atoms = kind.atoms(config.learning)
    with foreign(f"the network of the algorithm {kind.name}"), torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        network: QNetwork = resolve(kind.network)(
            actions, config.play.frame_stack, width, config.learning, atoms=atoms
        )
        if type(network) is not QNetwork:
            _try(network, config.play.frame_stack, width, atoms)
    return network


def _try(network: QNetwork, frame_stack: int, width: int, atoms: int) -> None:
    """Raises InputError if a ``network`` of another package gives a state no outputs as
    `QNetwork.atoms` does."""
    frames = torch.zeros(1, frame_stack, *FRAME_SHAPE, dtype=torch.uint8)
    with torch.inference_mode():
        outputs = network.atoms(frames, torch.zeros(1, width))
    found = [*outputs.shape], outputs.dtype
    if found != ([1, network.action_count, atoms], torch.float32):
        raise InputError(
            f"{type(network).__name__}.atoms gives {found[1]} {found[0]} for one state: give "
            f"float32 {[1, network.action_count, atoms]}."
        )


def count_actions_of(config: RunConfig, weights: Mapping[str, Tensor]) -> int:
    """Returns the number of actions of a network of ``config`` with these ``weights``. Raises
    KeyError if the weights are not those of such a network."""
    kind = ALGORITHMS.find(config.learning.algorithm)
    return len(weights["actions.bias"]) // kind.atoms(config.learning)
