"""stable-baselines3's DQN at the 2017 ratio of updates to steps, for `peers` and `lab.race`."""

import time
from collections.abc import Callable
from typing import Any

import ale_py
import gymnasium
import torch

from common.settings.config import RunConfig
from common.settings.presets import PRESETS

_WARM_UP = 256
_ENDLESS = 10**9


Point = tuple[float, int, float]
"""A point of a learning curve: seconds of the run, agent steps, and mean score."""
SAMPLE_SECONDS = 10.0


def _dqn(**settings: Any) -> Any:
    """Returns a DQN for Pong, with a buffer of 100,000 steps and a batch of 32 after each 4 steps.

    Everything else has its default, or the value in ``settings``.
    """
    # Imported here, because it is not a dependency of this project.
    from stable_baselines3 import DQN
    from stable_baselines3.common.env_util import make_atari_env
    from stable_baselines3.common.vec_env import VecFrameStack

    gymnasium.register_envs(ale_py)
    emulator = {"frameskip": 1, "repeat_action_probability": 0.0}
    return DQN(
        "CnnPolicy",
        VecFrameStack(make_atari_env("ALE/Pong-v5", n_envs=1, env_kwargs=emulator), n_stack=4),
        buffer_size=100_000,
        batch_size=32,
        train_freq=4,
        gradient_steps=1,
        **settings,
    )


def peer_curve(config: RunConfig, seconds: float, recent: int) -> list[Point]:
    """Trains for ``seconds`` with all cores; returns the mean of the last ``recent`` training games
    every 10 s.

    Args:
        config: gives the peer's warm-up, ε and seed.
    """
    model = _dqn(
        learning_starts=config.replay.learning_starts,
        exploration_initial_eps=config.exploration.start,
        exploration_final_eps=config.exploration.end,
        exploration_fraction=config.exploration.steps / _ENDLESS,
        target_update_interval=1_000,  # as in RL Baselines3 Zoo for Atari games
        stats_window_size=recent,
        seed=config.seed,
    )
    began = time.monotonic()
    points: list[Point] = []

    def sample(*_: Any) -> bool:
        now, games = time.monotonic() - began, model.ep_info_buffer
        if len(games) == recent and now >= (points[-1][0] if points else 0) + SAMPLE_SECONDS:
            points.append((now, model.num_timesteps, sum(game["r"] for game in games) / recent))
        return now < seconds

    model.learn(_ENDLESS, callback=sample)
    return points


def peer_dqn() -> Callable[[float, int], float]:
    """Returns a function that continues training for given seconds with a given number of threads
    and returns the agent steps per second.

    It trains in one process, as the users of stable-baselines3 do.
    """
    epsilon = PRESETS["paper"].exploration.end
    model = _dqn(
        learning_starts=_WARM_UP, exploration_initial_eps=epsilon, exploration_final_eps=epsilon
    )

    def train(seconds: float, threads: int) -> float:
        torch.set_num_threads(threads)
        before, began = model.num_timesteps, time.monotonic()
        model.learn(
            _ENDLESS,
            callback=lambda *_: time.monotonic() < began + seconds,  # at every step
            reset_num_timesteps=False,
        )
        return float(model.num_timesteps - before) / (time.monotonic() - began)

    return train
