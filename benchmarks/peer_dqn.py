"""stable-baselines3's DQN at the report's ratio, for `benchmarks.peers`."""

import time
from collections.abc import Callable
from typing import Any

import ale_py
import gymnasium
import torch

from common.run.presets import PRESETS

_WARM_UP = 256


def peer_dqn() -> Callable[[float, int], float]:
    """Returns what goes on training for so many seconds with so many threads, in one process as its
    users run it, and returns the agent steps per second.

    It has a buffer of 100,000 steps, and learns from a batch of 32 after each 4 steps.
    """
    # Here, because it is no dependency of this project.
    from stable_baselines3 import DQN
    from stable_baselines3.common.env_util import make_atari_env
    from stable_baselines3.common.vec_env import VecFrameStack

    gymnasium.register_envs(ale_py)
    emulator = {"frameskip": 1, "repeat_action_probability": 0.0}
    epsilon = PRESETS["paper"].exploration.end
    model: Any = DQN(
        "CnnPolicy",
        VecFrameStack(make_atari_env("ALE/Pong-v5", n_envs=1, env_kwargs=emulator), n_stack=4),
        buffer_size=100_000,
        batch_size=32,
        train_freq=4,
        gradient_steps=1,
        learning_starts=_WARM_UP,
        exploration_initial_eps=epsilon,
        exploration_final_eps=epsilon,
    )

    def train(seconds: float, threads: int) -> float:
        torch.set_num_threads(threads)
        before, began = model.num_timesteps, time.monotonic()
        model.learn(
            10**9,
            callback=lambda *_: time.monotonic() < began + seconds,  # at every step
            reset_num_timesteps=False,
        )
        return float(model.num_timesteps - before) / (time.monotonic() - began)

    return train
