"""The networks of the algorithms, shared by learner and actors: those of Mnih et al. 2015 and 2013,
and the same with several numbers for each action, such as quantiles of its return.

It stands here, not with the learner, so that an actor can play without the training code.
"""

from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d, relu

from common.protocol.step_fields import FRAME_SHAPE
from common.registry import ALGORITHMS, resolve
from common.run.config import InitialWeights, LearningConfig, NetworkName, RunConfig


class Layers(NamedTuple):
    """Sizes of a network's layers, between its states and its actions."""

    convolutions: tuple[tuple[int, int, int], ...]
    """Channels, kernel and stride of each; kernels and strides are square."""
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
        learning: which layers there are, how they take pixels, and their first weights.
        atoms: numbers that the last layer has for each action; their mean is its value.
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
        # 64 grey levels are about the deviation of centred pixels.
        scale = 1 / 64 if learning.center_pixels else 1 / 255
        self.pixel_scale = scale if learning.scale_pixels else 1.0
        self._center_pixels = learning.center_pixels
        self._frame_differences = learning.frame_differences
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
        # Channels last is the layout in which the CPU's and the GPU's convolutions are fastest.
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def _initialise(self, kind: InitialWeights) -> None:
        """Draw the first weights.

        PyTorch's have a sixth of He's variance, so that of a picture's differences a two-hundredth
        reaches the last layer, and as little of its errors the first. He's keep their size (He et
        al. 2015); the last layer's are a tenth, for first values near 0.
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
        """Returns uint8 frames in the type and memory layout that the first convolution wants.

        Whoever puts the same frames through two networks does this once.

        Args:
            frames: ``uint8 [batch, frame_stack, height, width]``.
            dtype: of the result; bfloat16 too has all of its values exactly, -255 to 255.
        """
        # In two steps: together they would take PyTorch's slow path, twice as long.
        pixels = frames.to(dtype).contiguous(memory_format=torch.channels_last)
        whole = pixels  # those that are no differences
        if self._frame_differences:
            # In place and newest first, or the next would be a difference of differences.
            for frame in reversed(range(1, pixels.shape[1])):
                pixels[:, frame] -= pixels[:, frame - 1]
            whole, frames = pixels[:, :1], frames[:, :1]
        if self._center_pixels:  # with differences, from the oldest frame its own mean
            mean = frames.flatten(1).float().mean(dim=1).round()
            whole -= mean.to(dtype).view(-1, 1, 1, 1)
        return pixels

    def forward(self, frames: Tensor, vectors: Tensor) -> Tensor:
        """Returns Q-values, ``float32 [batch, actions]``.

        Args:
            frames: ``uint8 [batch, frame_stack, 84, 84]``, newest last; or those by `as_pixels`,
                whose precision is then that of all layers.
            vectors: ``float32 [batch, P]``; P may be 0.
        """
        return self.atoms(frames, vectors).mean(dim=2)

    def atoms(self, frames: Tensor, vectors: Tensor) -> Tensor:
        """Returns the last layer's numbers, ``float32 [batch, actions, atoms]``."""
        hidden = self.hidden(self._features(frames, vectors))
        if self.norm is not None:  # in float32, whatever the layers' precision
            hidden = self.norm(hidden.float()).to(hidden.dtype)
        numbers: Tensor = self.actions(relu(hidden)).float()
        return numbers.view(len(numbers), self.action_count, -1)

    def _features(self, frames: Tensor, vectors: Tensor) -> Tensor:
        """Returns what the first dense layer sees, ``[batch, features]``."""
        pixels = frames if frames.is_floating_point() else self.as_pixels(frames)
        first, *others = self.convolutions
        assert isinstance(first, nn.Conv2d)
        # Scaling the first layer's few weights is the same sum as scaling a million pixels.
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
    """Returns the run's network with its first weights, the same for every process of the run;
    ``vector_width`` is that of another vector observation than the run's."""
    kind = ALGORITHMS.find(config.learning.algorithm)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        network: QNetwork = resolve(kind.network)(
            actions,
            config.play.frame_stack,
            config.vector_width if vector_width is None else vector_width,
            config.learning,
            atoms=kind.atoms(config.learning),
        )
    return network


def count_actions_of(config: RunConfig, weights: Mapping[str, Tensor]) -> int:
    """Returns between how many actions a network of ``config`` with these ``weights`` chooses.
    Raises KeyError if they are no weights of such a network."""
    kind = ALGORITHMS.find(config.learning.algorithm)
    return len(weights["actions.bias"]) // kind.atoms(config.learning)
