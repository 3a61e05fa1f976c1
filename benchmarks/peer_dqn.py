"""`PeerDQN`: stable-baselines3's DQN at the report's ratio, for `benchmarks.peers`."""

import time
from typing import Any

import ale_py
import gymnasium
import torch

from common.run.presets import PRESETS

_WARM_UP = 256


class PeerDQN:
    """One process, as its users run it: a buffer of 100,000 steps, a batch of 32 each 4 steps."""

    def __init__(self) -> None:
        # Here, because it is no dependency of this project.
        from stable_baselines3 import DQN
        from stable_baselines3.common.callbacks import BaseCallback
        from stable_baselines3.common.env_util import make_atari_env
        from stable_baselines3.common.vec_env import VecFrameStack

        class Until(BaseCallback):  # type: ignore[misc,unused-ignore]
            """Ends the training when the time is over."""

            deadline = 0.0

            def _on_step(self) -> bool:
                return time.monotonic() < self.deadline

        gymnasium.register_envs(ale_py)
        env = VecFrameStack(
            make_atari_env(
                "ALE/Pong-v5",
                n_envs=1,
                env_kwargs={"frameskip": 1, "repeat_action_probability": 0.0},
            ),
            n_stack=4,
        )
        epsilon = PRESETS["paper"].exploration.end
        self._until = Until()
        self._model: Any = DQN(
            "CnnPolicy",
            env,
            buffer_size=100_000,
            batch_size=32,
            train_freq=4,
            gradient_steps=1,
            learning_starts=_WARM_UP,
            exploration_initial_eps=epsilon,
            exploration_final_eps=epsilon,
        )

    def train(self, seconds: float, threads: int) -> float:
        """Go on training for so long with so many threads; the agent steps per second."""
        torch.set_num_threads(threads)
        before = self._model.num_timesteps
        began = time.monotonic()
        self._until.deadline = began + seconds
        self._model.learn(10**9, callback=self._until, reset_num_timesteps=False)
        return float(self._model.num_timesteps - before) / (time.monotonic() - began)
