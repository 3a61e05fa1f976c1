"""Another environment: a class, and its entry in the registry."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from actors.envs.step_info import StepInfo
from common.registry import ENVIRONMENTS, Environment
from common.run.clock import ClockConfig
from common.run.conditions import PlayConfig
from common.run.config import RunConfig, StreamConfig
from common.run.presets import PRESETS
from tests.extending.whole_run import added, learned

GAME_STEPS = 10


class Lamps(gymnasium.Env[Any, np.int64]):
    """Three lamps: to name the one that is lit makes a point; a game has ten of them."""

    def __init__(self, play: PlayConfig) -> None:
        self.action_space = gymnasium.spaces.Discrete(3)
        shape = (play.frame_stack, 84, 84)
        self.observation_space = gymnasium.spaces.Box(0, 255, shape, np.uint8)
        self._frames = np.zeros(shape, np.uint8)
        self._score, self._steps = 0.0, 0

    @classmethod
    def of_run(cls, config: RunConfig, clock: ClockConfig, *, training: bool) -> "Lamps":
        assert clock == ClockConfig()
        return cls(config.play)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self._score, self._steps = 0.0, 0
        return self._look(), StepInfo(False, 0.0, 0, elapsed=0)._asdict()

    def step(self, action: np.int64) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        reward = float(action == self._lit)
        self._score += reward
        self._steps += 1
        over = self._steps == GAME_STEPS
        info = StepInfo(over, self._score, self._steps)
        return self._look(), reward, over, False, info._asdict()

    def _look(self) -> Any:
        self._lit = int(self.np_random.integers(3))
        self._frames = np.roll(self._frames, -1, axis=0)
        self._frames[-1] = 0
        self._frames[-1, :, 28 * self._lit : 28 * (self._lit + 1)] = 255
        return self._frames.copy()


_FAST = PRESETS["fast"]
CONFIG = replace(
    _FAST,
    env="lamps",
    game="lamps",
    stream=StreamConfig(chunk_steps=16, window=2),
    replay=replace(_FAST.replay, capacity=5_000, learning_starts=64, ratio_tolerance=64),
    learning=replace(_FAST.learning, batch_size=4, train_period=8, publish_period=1),
    protocol=replace(_FAST.protocol, epoch_steps=10_000, held_out_states=16),
)
"""A run of a second."""
LAMPS = Environment("lamps", Lamps.of_run, lambda config: 3, title="Lamps")


def test_an_environment_from_outside_is_learned(tmp_path: Path) -> None:
    with added(ENVIRONMENTS, LAMPS):
        summary, policy = learned(CONFIG, tmp_path, steps=240)
    assert summary["env"] == "lamps"
    assert summary["agent_steps"] >= 240
    assert summary["updates"] > 0
    assert summary["games"] >= 10
    assert policy.weights_version > 0
    # A third of ten, by chance.
    assert 1 < summary["random_reward"] < 6
