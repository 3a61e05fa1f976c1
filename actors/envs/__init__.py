"""The environments an actor plays in, under their Gymnasium names.

``ALERobot/<Game>-v0`` is the robot, ``ALERobot/<Game>-Emulator-v0`` the emulator alone, for every
game of `GAMES`. Entry points are text and imports late, so that PyBullet and OpenCV are loaded
only where they are used.
"""

from typing import Any

import gymnasium

from actors.envs.emulator import GAMES, Emulator
from common.actions import KEYS_OF_ACTION
from common.run.config import RunConfig


def env_id(game: str, *, robot: bool) -> str:
    """Gymnasium's name of a game: ``ALERobot/SpaceInvaders-v0`` for space_invaders."""
    name = "".join(part.title() for part in game.split("_"))
    return f"ALERobot/{name}-v0" if robot else f"ALERobot/{name}-Emulator-v0"


def make_env(
    config: RunConfig,
    *,
    training: bool,
    sync: bool = True,
    wait_action: bool = False,
    speed: float = 1.0,
) -> gymnasium.Env[Any, Any]:
    """The environment of a run.

    Args:
        training: let episodes end at a lost life.
        sync, wait_action, speed: the robot's clock, see `RobotEnv`; they do not concern the bare
            emulator.

    Raises:
        InputError: ale-py does not bundle ``config.game``.
    """
    if config.env == "ale":
        from actors.envs.ale import AtariEnv

        return AtariEnv(config.game, play=config.play, training=training)
    from actors.envs.robot import RobotEnv

    return RobotEnv(
        config.game,
        play=config.play,
        camera=config.camera,
        training=training,
        sync=sync,
        wait_action=wait_action,
        speed=speed,
        discount=config.learning.discount,
        clip_rewards=config.learning.clip_rewards,
    )


def count_actions(config: RunConfig) -> int:
    """Actions that the run's environment offers.

    Raises:
        InputError: ale-py does not bundle ``config.game``.
    """
    minimal = Emulator(config.game, config.seed).minimal_actions
    return len(minimal if config.play.minimal_actions else KEYS_OF_ACTION)


for _game in GAMES:
    gymnasium.register(
        env_id(_game, robot=True), "actors.envs.robot:RobotEnv", kwargs={"game": _game}
    )
    gymnasium.register(
        env_id(_game, robot=False), "actors.envs.ale:AtariEnv", kwargs={"game": _game}
    )
