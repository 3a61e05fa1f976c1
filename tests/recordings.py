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
from tests.actors.numbered_env import NumberedEnv
from viewer.recorder import Recorder

CONFIG = PRESETS["fast"]
_WITH_VECTOR = replace(CONFIG.play, vector=True, vector_commands=1, vector_key_frames=1)
WITH_VECTOR = replace(CONFIG, play=_WITH_VECTOR)


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
