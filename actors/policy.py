"""The ε-greedy policy: one forward pass for all environments of the process."""

from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from actors.exploration import GREEDY, Exploration
from common.settings.config import ExplorationConfig, RunConfig

if TYPE_CHECKING:
    from common.network import QNetwork

# PyTorch is imported only where it computes, so that help and wrong flags are answered at once.


class Policy:
    """A policy that is greedy on the network's values, except for a share ``epsilon`` of random
    agent steps."""

    def __init__(
        self,
        network: "QNetwork",
        actions: int,
        rng: np.random.Generator,
        *,
        envs: int = 1,
        exploration: ExplorationConfig | None = None,
    ) -> None:
        """``exploration`` says how random actions are drawn; by default, each step draws anew."""
        self.network = network.eval()
        self.weights_version = 0
        self.epsilon = 1.0
        self.explored: NDArray[np.bool_] = np.ones(envs, np.bool_)
        """Which of the last actions were random, ``[E]``."""
        self._exploration = Exploration(exploration or ExplorationConfig(), actions, envs, rng)

    @classmethod
    def of_file(cls, config: RunConfig, weights: Path | None, epsilon: float, seed: int) -> Self:
        """Returns the policy of the network in the file ``weights``; without a file, a random one,
        whatever ``epsilon``.

        Raises:
            InputError: the file cannot be read, or does not fit ``config``.
        """
        from common.network import build_network
        from common.run.network_file import load_network_file

        actions = config.action_count
        policy = cls(build_network(config, actions), actions, np.random.default_rng(seed))
        if weights is not None:
            what = f"{config.played} with {actions} actions"
            load_network_file(policy.network, weights, what)
            policy.epsilon = epsilon
        return policy

    def act(self, frames: NDArray[np.uint8], vectors: NDArray[np.float32]) -> NDArray[np.int64]:
        """Returns one action for each environment; see `actors.loop.Player`."""
        chosen = self._exploration.draw(self.epsilon)
        self.explored = chosen != GREEDY
        greedy = np.flatnonzero(~self.explored)
        if greedy.size:
            chosen[greedy] = self.q_values(frames[greedy], vectors[greedy]).argmax(axis=1)
        return chosen

    def q_values(
        self, frames: NDArray[np.uint8], vectors: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Returns the Q-values of all actions, ``[E, A]``, in states as `act` gets them."""
        import torch

        with torch.inference_mode():
            values: NDArray[np.float32] = self.network(
                torch.from_numpy(frames), torch.from_numpy(vectors)
            ).numpy()
        return values
