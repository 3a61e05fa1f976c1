"""stable-baselines3's DQN at the report's ratio, for `benchmarks.peers` and `lab.race`."""

import time
from collections.abc import Callable
from typing import Any

import ale_py
import gymnasium
import torch

from common.run.config import RunConfig
from common.run.presets import PRESETS

_WARM_UP = 256
_ENDLESS = 10**9


Point = tuple[float, int, float]
"""Seconds of a run, its agent steps, and a mean score there."""
SAMPLE_SECONDS = 10.0


def _dqn(**settings: Any) -> Any:
    """Returns a DQN of Pong with a buffer of 100,000 steps, that learns from a batch of 32 after
    each 4 steps; the rest is as it comes, or as ``settings`` say."""
    # Here, because it is no dependency of this project.
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
    """Returns the mean of the ``recent`` training games every 10 s, from training that long with
    all cores.

    Args:
        config: its warm-up, its ε and its seed are the peer's too.
    """
    model = _dqn(
        learning_starts=config.replay.learning_starts,
        exploration_initial_eps=config.exploration.start,
        exploration_final_eps=config.exploration.end,
        exploration_fraction=config.exploration.steps / _ENDLESS,
        target_update_interval=1_000,  # as RL Baselines3 Zoo has it for Atari games
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
    """Returns what goes on training for so many seconds with so many threads, in one process as its
    users run it, and returns the agent steps per second."""
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
