"""The networks of the algorithms, shared by learner and actors: that of Mnih et al. 2015, and the
same with quantiles of each action's return (Dabney et al. 2018).

With ``dueling`` the second dense layer is two: one half of the hidden units makes the state's
value, the other the actions' advantages, less their mean (Wang et al. 2016, equation 9). Halves,
not two layers of 512 each, so that it is as fast as the plain one.

It stands here, not with the learner, so that an actor can play without the training code.
"""

from collections.abc import Callable, Mapping

import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d, relu

from common.run.config import RunConfig

HIDDEN = 512
"""Units of the first dense layer."""


def as_pixels(frames: Tensor, dtype: torch.dtype = torch.float32) -> Tensor:
    """uint8 frames in the type and memory layout that the first convolution wants.

    Whoever puts the same frames through two networks does this once. 0 to 255 are exact in
    bfloat16 too.
    """
    # In two steps: together they would take PyTorch's slow path, twice as long.
    return frames.to(dtype).contiguous(memory_format=torch.channels_last)


class QNetwork(nn.Module):
    """Three convolutions and two dense layers: state → value of each action.

    Args:
        atoms: numbers that the last layer has for each action; a subclass that has more than one
            makes the values of them.
    """

    def __init__(
        self,
        actions: int,
        frame_stack: int = 4,
        vector_width: int = 0,
        *,
        scale_pixels: bool = True,
        vector_scale: float = 1.0,
        glorot: bool = False,
        dueling: bool = False,
        atoms: int = 1,
    ) -> None:
        super().__init__()
        self.action_count = actions
        self.dueling = dueling
        self.pixel_scale = 1 / 255 if scale_pixels else 1.0
        self.vector_scale = vector_scale
        self.convolutions = nn.Sequential(
            nn.Conv2d(frame_stack, 32, 8, stride=4),
            nn.ReLU(),
            nn.Conv2d(32, 64, 4, stride=2),
            nn.ReLU(),
            nn.Conv2d(64, 64, 3),
            nn.ReLU(),
        )
        self.hidden = nn.Linear(64 * 7 * 7 + vector_width, HIDDEN)
        self.actions = nn.Linear(HIDDEN // 2 if dueling else HIDDEN, actions * atoms)
        """Of the actions' values, or of their advantages."""
        self.value = nn.Linear(HIDDEN // 2, atoms) if dueling else None
        if glorot:
            for layer in self.modules():
                if isinstance(layer, (nn.Conv2d, nn.Linear)):
                    nn.init.xavier_uniform_(layer.weight)
                    nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
        # Channels last is the layout in which the CPU's and the GPU's convolutions are fastest.
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, frames: Tensor, vectors: Tensor) -> Tensor:
        """Returns Q-values, ``float32 [batch, actions]``.

        Args:
            frames: ``uint8 [batch, frame_stack, 84, 84]``, newest last; or those `as_pixels`, whose
                precision is then that of all layers.
            vectors: ``float32 [batch, P]``; P may be 0.
        """
        return self.atoms(frames, vectors).squeeze(2)

    def atoms(self, frames: Tensor, vectors: Tensor) -> Tensor:
        """Returns the last layer's numbers, ``float32 [batch, actions, atoms]``."""
        hidden = relu(self.hidden(self._features(frames, vectors)))
        if self.value is None:
            return self._by_action(self.actions(hidden))
        for_value, for_actions = hidden.chunk(2, dim=1)
        # The mean in float32: rounded, it would blur which action is the best.
        advantages = self._by_action(self.actions(for_actions))
        value: Tensor = self.value(for_value).float().unsqueeze(1)
        return value + advantages - advantages.mean(dim=1, keepdim=True)

    def _by_action(self, numbers: Tensor) -> Tensor:
        return numbers.float().view(len(numbers), self.action_count, -1)

    def _features(self, frames: Tensor, vectors: Tensor) -> Tensor:
        """Returns what the first dense layer sees, ``[batch, features]``."""
        pixels = frames if frames.is_floating_point() else as_pixels(frames)
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
            scaled = vectors * self.vector_scale
            features = torch.cat((features, scaled.to(features.dtype)), dim=1)
        return features


class QuantileNetwork(QNetwork):
    """State → quantiles of each action's return; its value is their mean."""

    def forward(self, frames: Tensor, vectors: Tensor) -> Tensor:
        """See `QNetwork.forward`."""
        return self.quantiles(frames, vectors).mean(dim=2)

    def quantiles(self, frames: Tensor, vectors: Tensor) -> Tensor:
        """Returns ``float32 [batch, actions, quantiles]``, at the midpoints of equal shares.

        Not sorted: nothing but the loss keeps a quantile below the next.
        """
        return self.atoms(frames, vectors)


NETWORKS: dict[str, tuple[type[QNetwork], Callable[[RunConfig], int]]] = {
    "dqn": (QNetwork, lambda config: 1),
    "qr_dqn": (QuantileNetwork, lambda config: config.learning.quantiles),
}
"""Class and atoms of the network that an algorithm learns; of ``dqn``'s, if it is not named."""


def build_network(config: RunConfig, actions: int) -> QNetwork:
    """Returns the run's network with its first weights; the same for every process of the run."""
    kind, atoms = _network_of(config)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        return kind(
            actions,
            config.play.frame_stack,
            config.vector_width,
            scale_pixels=config.learning.scale_pixels,
            vector_scale=config.learning.vector_scale,
            glorot=config.learning.initial_weights == "glorot",
            dueling=config.learning.dueling,
            atoms=atoms,
        )


def count_actions_of(config: RunConfig, weights: Mapping[str, Tensor]) -> int:
    """Returns between how many actions a network of ``config`` with these ``weights`` chooses.

    Raises:
        KeyError: they are no weights of such a network.
    """
    _, atoms = _network_of(config)
    return len(weights["actions.bias"]) // atoms


def _network_of(config: RunConfig) -> tuple[type[QNetwork], int]:
    kind, atoms = NETWORKS.get(config.learning.algorithm, NETWORKS["dqn"])
    return kind, atoms(config)
