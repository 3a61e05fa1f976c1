"""A replay of real frames: what a random policy lives through in the bare emulator."""

from dataclasses import replace
from pathlib import Path

from actors.envs import make_env
from actors.loop import play
from actors.policy import Policy
from actors.stream.chunker import Chunker
from common.run.config import RunConfig
from replay.replay_buffer import ReplayBuffer


def random_play(config: RunConfig, steps: int, folder: Path) -> ReplayBuffer:
    """The run's replay after ``steps`` random agent steps, with a limiter that never says wait."""
    config = replace(
        config,
        replay=replace(config.replay, capacity=2 * steps, learning_starts=1, ratio_tolerance=10**9),
    )
    env = make_env(config, training=True)
    policy = Policy.of_file(config, None, 1.0, config.seed)
    chunker = Chunker("random-play", "actor-1", 1, 0, config.stream.chunk_steps)
    buffer = ReplayBuffer(config, folder)
    for number, step in enumerate(play([env], policy, [config.seed])):
        if (chunk := chunker.add(step)) is not None:
            buffer.insert(chunk)
        if number == steps:
            break
    env.close()
    return buffer
