"""Exploration: which agent steps are random, and by which action (ε-greedy, εz-greedy).

Random actions that are redrawn at every agent step make an arm tremble: it has hardly set out for
one key when it is sent to another. With ``ez_greedy`` a random action lasts for a while (εz-greedy:
Dabney, Ostrovski and Barreto 2021, "Temporally-extended ε-greedy exploration").
"""

import numpy as np
from numpy.typing import NDArray

from common.settings.config import ExplorationConfig

GREEDY = -1
_DURATIONS = np.arange(4, 13)
"""Agent steps that a random action lasts with ``ez_greedy``: 3 + Zipf(2), at most 12."""
DURATION_LAW = 6 / np.pi**2 / (_DURATIONS - 3.0) ** 2
"""Probability of each duration; Zipf(2) is 6/π² / k², and the last one has what is left."""
DURATION_LAW[-1] += 1 - DURATION_LAW.sum()
MEAN_DURATION = float(DURATION_LAW @ _DURATIONS)


class Exploration:
    """Draws the random actions of ``envs`` environments. A random action that lasts goes on in the
    next episode: who explores does not look at what is seen."""

    def __init__(
        self, config: ExplorationConfig, actions: int, envs: int, rng: np.random.Generator
    ) -> None:
        self._ez_greedy = config.ez_greedy
        self._actions = actions
        self._rng = rng
        self._held = np.zeros(envs, np.int64)
        self._left = np.zeros(envs, np.int64)

    def draw(self, epsilon: float) -> NDArray[np.int64]:
        """Returns a random action, or `GREEDY`, for each environment's next agent step, ``[E]``."""
        envs = len(self._held)
        if not self._ez_greedy:
            chosen = self._rng.integers(self._actions, size=envs)
            chosen[self._rng.random(envs) >= epsilon] = GREEDY
            return chosen
        # Random runs of mean m begin at a share p of the other agent steps: ε = pm / (pm + 1 - p).
        begin = epsilon / (epsilon + MEAN_DURATION * (1 - epsilon))
        begins = (self._left == 0) & (self._rng.random(envs) < begin)
        self._held[begins] = self._rng.integers(self._actions, size=begins.sum())
        self._left[begins] = self._rng.choice(_DURATIONS, size=begins.sum(), p=DURATION_LAW)
        held = self._left > 0
        self._left[held] -= 1
        return np.where(held, self._held, GREEDY)
