"""What the tests know of an environment beyond its declared types; anything else fails."""

from pathlib import Path

import numpy as np
from ale_py import roms
from numpy.typing import NDArray

from actors.envs.observation import Observation
from actors.envs.robot import RobotEnv
from actors.robots.nao.robot import Nao


def frames_of(observation: Observation) -> NDArray[np.uint8]:
    """The observation of an environment without a vector."""
    assert isinstance(observation, np.ndarray)
    return observation


def nao_of(env: RobotEnv) -> Nao:
    assert isinstance(env.robot, Nao)
    return env.robot


def rom_of(game: str) -> Path:
    """The file of a game that ale-py bundles."""
    path = roms.get_rom_path(game)
    assert path is not None
    return path
