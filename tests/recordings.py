"""Small recordings of scripted games."""

import itertools
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np

from actors.envs.checked import CheckedEnv
from actors.loop import play
from actors.policy import Policy
from common.network import QNetwork
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from tests.actors.numbered_env import GAME_OVER, GOES_ON, LOSES_A_LIFE, NumberedEnv
from viewer.recorder import Recorder

CONFIG = PRESETS["fast"]
_WITH_VECTOR = replace(CONFIG.play, vector=True, vector_commands=1, vector_key_frames=1)
WITH_VECTOR = replace(CONFIG, play=_WITH_VECTOR)
SCRIPT = [*[GOES_ON] * 9, LOSES_A_LIFE, *[GOES_ON] * 5, GAME_OVER]


def run_config(config: RunConfig = CONFIG, *, capacity: int = 2_000, length: int = 8) -> RunConfig:
    return replace(
        config,
        replay=replace(config.replay, capacity=capacity, learning_starts=100),
        learning=replace(config.learning, batch_size=32),
        stream=replace(config.stream, chunk_steps=length),
    )


def record(
    folder: Path, script: Sequence[str], steps: int, config: RunConfig = CONFIG
) -> NumberedEnv:
    """Records so many steps of random play; returns the environment, which remembers them."""
    env = NumberedEnv(script, config.play.frame_stack, width=config.vector_width)
    policy = Policy(QNetwork(6), 6, np.random.default_rng(0))
    with closing(Recorder(CheckedEnv(env, config), config, folder)) as recorder:
        for step in itertools.islice(play([recorder], policy, [0]), steps):
            recorder.add(step)
    return env
