"""Who plays for show: random actions, or a network from a run's weights, with its values kept."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from actors.policy import Policy
from common.registry import ENVIRONMENTS
from common.run.config import RunConfig
from common.run.origin import origin_of
from common.run.presets import PRESETS


class ShownPolicy(Policy):
    """A policy that remembers the values of every state that it was asked about."""

    values: NDArray[np.float32] | None = None
    """``float32 [actions]`` of the last state; None while play is all random."""

    def act(self, frames: NDArray[np.uint8], vectors: NDArray[np.float32]) -> NDArray[np.int64]:
        """As `Policy.act`, for one environment."""
        if self.epsilon < 1.0:
            with torch.inference_mode():
                values = self.network(torch.from_numpy(frames), torch.from_numpy(vectors))
            self.values = values[0].numpy()
        return super().act(frames, vectors)


def config_to_play(
    weights: Path | None, env: str | None, game: str | None, minimal_actions: bool
) -> RunConfig:
    """What is played: as the run of ``weights`` did, changed by what else is given.

    Without a run or a card it is Pong, by the robot, with all 18 actions.

    Raises:
        InputError: the configuration of the run, or that in the card, cannot be read.
    """
    config = None if weights is None else origin_of(weights)
    if config is None:
        config = PRESETS[ENVIRONMENTS.find(env or RunConfig.env).preset]
        config = replace(config, play=replace(config.play, minimal_actions=False))
    if minimal_actions:
        config = replace(config, play=replace(config.play, minimal_actions=True))
    return replace(config, env=env or config.env, game=game or config.game)
