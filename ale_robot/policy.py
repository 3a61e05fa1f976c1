"""Trained policies: loads them with the settings of their training, plays them, evaluates them."""

import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from actors.envs import make_env
from actors.envs.observation import Observation, frames_and_vector
from actors.policy import Policy
from common.errors import InputError
from common.run.clock import ClockConfig
from common.run.origin import find_weights, origin_of
from learner.evaluation import offline
from learner.evaluation.options import EPSILON, GAMES, EvaluationOptions
from viewer.player import settings_of


class TrainedPolicy:
    """A network and the settings that it was trained under; it plays ε-greedily.

    Args:
        weights: a file, or the name of a shipped policy, such as "robot_pong".
        epsilon: share of random actions.
        seed: seed of the random actions.

    Raises:
        InputError: there is no such network, or it cannot be read.
    """

    def __init__(self, weights: str | Path, *, epsilon: float = 0.0, seed: int = 1) -> None:
        self.weights = find_weights(weights)
        self.config = settings_of(self.weights)
        self._policy = Policy.of_file(self.config, self.weights, epsilon, seed)

    def make_env(self) -> gymnasium.Env[Any, Any]:
        """Returns an environment with the settings of its training, whose episodes are whole
        games."""
        return make_env(self.config, training=False)

    def act(self, observation: Observation) -> int:
        """Returns the index of an action, for an observation of `make_env`."""
        return int(self._policy.act(*self._batch(observation))[0])

    def q_values(self, observation: Observation) -> NDArray[np.float32]:
        """Returns the value of each action, ``float32 [actions]``."""
        values: NDArray[np.float32] = self._policy.q_values(*self._batch(observation))[0]
        return values

    @staticmethod
    def _batch(observation: Observation) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        frames, vector = frames_and_vector(observation)
        return frames[None], vector[None]


load_policy = TrainedPolicy


def evaluate(
    weights: str | Path,
    *,
    games: int = GAMES,
    epsilon: float = EPSILON,
    seed: int = 1,
    processes: int = 0,
) -> dict[str, Any]:
    """Plays whole games in several processes, as ``ale-robot evaluate`` does.

    Args:
        processes: number of games played at the same time; 0 for as many as there are cores.

    Returns:
        What ``ale-robot evaluate --json`` writes: "mean", "deviation", "iqm", "scores", …

    Raises:
        InputError: there is no such network, or the settings of its training are unknown.
    """
    file = find_weights(weights)
    if (trained := origin_of(file)) is None:
        raise InputError(f"{file} has neither a card nor a run: keep it in its run's folder.")
    options = EvaluationOptions(file, games=games, epsilon=epsilon, processes=processes)
    options.check()
    found = offline.evaluate(
        options,
        replace(trained.for_play, seed=seed),
        trained,
        ClockConfig(),
        threading.Event(),
        Console(quiet=True),
    )
    assert found is not None  # nobody stops it
    return found
