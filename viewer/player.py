"""Who plays for show: random actions, or a network from a run's weights, with its values kept."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from actors.policy import Policy
from common.network import QNetwork, build_network
from common.protocol.weights import load_weights_file
from common.run.config import EnvKind, RunConfig
from common.run.origin import origin_of
from common.run.presets import PRESETS


class ShownPolicy(Policy):
    """A policy that remembers the values of every state that it was asked about."""

    def __init__(self, network: QNetwork, actions: int, rng: np.random.Generator) -> None:
        super().__init__(network, actions, rng)
        self.values: NDArray[np.float32] | None = None
        """``float32 [actions]`` of the last state; None while play is all random."""

    def act(self, frames: NDArray[np.uint8], vectors: NDArray[np.float32]) -> NDArray[np.int64]:
        """As `Policy.act`, for one environment."""
        if self.epsilon < 1.0:
            with torch.inference_mode():
                values = self.network(torch.from_numpy(frames), torch.from_numpy(vectors))
            self.values = values[0].numpy()
        return super().act(frames, vectors)


def config_to_play(
    weights: Path | None, env: EnvKind | None, game: str | None, minimal_actions: bool
) -> RunConfig:
    """What is played: as the run of ``weights`` did, changed by what else is given.

    Without a run or a card it is Pong, by the robot, with all 18 actions.

    Raises:
        InputError: the configuration of the run, or that in the card, cannot be read.
    """
    config = None if weights is None else origin_of(weights)
    if config is None:
        config = PRESETS["fast" if env == "ale" else "robot"]
        config = replace(config, play=replace(config.play, minimal_actions=False))
    if minimal_actions:
        config = replace(config, play=replace(config.play, minimal_actions=True))
    return replace(config, env=env or config.env, game=game or config.game)


def build_player(
    config: RunConfig, actions: int, weights: Path | None, epsilon: float, seed: int
) -> ShownPolicy:
    """A policy with the network in ``weights``, or a random one without.

    Raises:
        InputError: the file cannot be read, or does not fit ``config``.
    """
    policy = ShownPolicy(build_network(config, actions), actions, np.random.default_rng(seed))
    if weights is None:
        return policy
    load_weights_file(
        policy.network,
        weights,
        f"{config.game} ({config.env}) with {actions} actions",
        "name what it was trained on by --env, --game and --minimal-actions",
    )
    policy.epsilon = epsilon
    return policy
