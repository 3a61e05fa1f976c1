"""Somebody else's agent learns on the robot: stable-baselines3's DQN, of the extra `dev`."""

import math
import warnings
from typing import Any

import gymnasium
import pytest
import torch

STEPS = 2_000
WARMUP, TRAIN_EVERY = 100, 8


class Record(gymnasium.Wrapper):
    """Keeps what every step said beside its observation."""

    def __init__(self, env: gymnasium.Env) -> None:
        super().__init__(env)
        self.infos: list[dict[str, Any]] = []

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        outcome = self.env.step(action)
        self.infos.append(outcome[4])
        return outcome


@pytest.mark.slow
def test_dqn_trains_on_the_robot() -> None:
    # Late, because they take seconds to load.
    from stable_baselines3 import DQN
    from stable_baselines3.common.env_checker import check_env

    env = Record(gymnasium.make("ale_robot:ALERobot/Pong-v0"))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            check_env(env)
        env.infos.clear()
        agent = DQN(
            "CnnPolicy",
            env,
            buffer_size=STEPS,
            learning_starts=WARMUP,
            batch_size=16,
            train_freq=TRAIN_EVERY,
            target_update_interval=500,
            policy_kwargs={"features_extractor_kwargs": {"features_dim": 64}},
            seed=1,
        )
        before = {name: value.clone() for name, value in agent.q_net.state_dict().items()}
        losses: list[float | None] = []

        def note(now: dict[str, Any], _: dict[str, Any]) -> bool:
            losses.append(loss_of(now["self"]))
            return True

        agent.learn(STEPS, callback=note)
    finally:
        env.close()
    assert agent.num_timesteps == len(env.infos) == STEPS
    assert all(info["valid_frame"] and info["elapsed"] == 1 for info in env.infos)
    assert sum(info["keys_match"] for info in env.infos) > 0.9 * STEPS
    # Pong is lost after 750 to 850 agent steps of chance.
    scores = [info["game_score"] for info in env.infos if info["game_over"]]
    assert agent.ep_info_buffer is not None
    assert len(scores) == len(agent.ep_info_buffer) >= 2
    assert all(-21 <= score <= 21 for score in scores)
    assert agent._n_updates == math.ceil((STEPS - WARMUP) / TRAIN_EVERY)
    learned = [loss for loss in losses if loss is not None]
    assert len(learned) > STEPS - 2 * WARMUP - 2 * TRAIN_EVERY
    assert all(math.isfinite(loss) and loss >= 0 for loss in learned)
    for name, value in agent.q_net.state_dict().items():
        assert torch.isfinite(value).all()
        assert not torch.equal(value, before[name]), name


def loss_of(agent: Any) -> float | None:
    """Returns the loss of the last update; None before the first."""
    loss: float | None = agent.logger.name_to_value.get("train/loss")
    return loss
