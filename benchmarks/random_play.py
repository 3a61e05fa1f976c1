"""A replay of real frames: random play in the emulator alone."""

from dataclasses import replace
from pathlib import Path

from actors.envs import make_env
from actors.loop import play, seeds_of
from actors.policy import Policy
from actors.stream.chunker import Chunker
from common.settings.config import RunConfig
from replay.replay_buffer import ReplayBuffer


def random_play(config: RunConfig, steps: int, folder: Path) -> ReplayBuffer:
    """Returns the run's replay after ``steps`` random agent steps; its limiter never waits."""
    config = replace(
        config,
        replay=replace(config.replay, capacity=2 * steps, learning_starts=1, ratio_tolerance=10**9),
    )
    env = make_env(config, training=True)
    policy_seed, env_seed = seeds_of(config.seed)
    policy = Policy.of_file(config, None, 1.0, policy_seed)
    chunker = Chunker("random-play", "actor-1", 1, 0, config.stream.chunk_steps)
    buffer = ReplayBuffer(config, folder)
    for number, step in enumerate(play([env], policy, [env_seed])):
        if (chunk := chunker.add(step)) is not None:
            buffer.insert(chunk)
        if number == steps:
            break
    env.close()
    return buffer
