"""The ε-greedy policy: one forward pass for all environments of the process."""

import numpy as np
import torch
from numpy.typing import NDArray

from common.network import QNetwork


class Policy:
    """Greedy on the network's values, but for a share ``epsilon`` of random actions."""

    def __init__(self, network: QNetwork, actions: int, rng: np.random.Generator) -> None:
        self.network = network.eval()
        self.weights_version = 0
        self.epsilon = 1.0
        self._actions = actions
        self._rng = rng

    def act(self, frames: NDArray[np.uint8], vectors: NDArray[np.float32]) -> NDArray[np.int64]:
        """One action for each environment, ``[E]``.

        Args:
            frames: states ``[E, history, 84, 84]``.
            vectors: vector observations ``[E, P]``.
        """
        chosen = self._rng.integers(self._actions, size=len(frames))
        greedy = np.flatnonzero(self._rng.random(len(frames)) >= self.epsilon)
        if greedy.size:
            with torch.inference_mode():
                values = self.network(
                    torch.from_numpy(frames[greedy]), torch.from_numpy(vectors[greedy])
                )
            chosen[greedy] = values.argmax(dim=1).numpy()
        return chosen
