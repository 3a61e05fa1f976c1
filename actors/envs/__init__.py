"""The environments an actor plays in.

`make_env` makes a run's environment by its name in `common.registry.ENVIRONMENTS`. Gymnasium knows
two for every game: ``ALERobot/<Game>-v0`` is the robot, ``ALERobot/<Game>-Emulator-v0`` the
emulator alone. Entry points are text, so that PyBullet, OpenCV and the viewer are loaded only
where they are used.
"""

from typing import Any

import gymnasium

from common.games import GAMES
from common.registry import ENVIRONMENTS
from common.run.clock import ClockConfig
from common.run.config import RunConfig


def env_id(game: str, *, robot: bool) -> str:
    """Returns Gymnasium's name of a game: ``ALERobot/SpaceInvaders-v0`` for space_invaders."""
    name = "".join(part.title() for part in game.split("_"))
    return f"ALERobot/{name}-v0" if robot else f"ALERobot/{name}-Emulator-v0"


def make_env(
    config: RunConfig, clock: ClockConfig | None = None, *, training: bool
) -> gymnasium.Env[Any, Any]:
    """Returns the environment of a run.

    Args:
        clock: how time passes in a robot's world; lockstep by default.
        training: whether a lost life ends an episode.

    Raises:
        InputError: there is no such environment, robot or game.
    """
    env: gymnasium.Env[Any, Any] = ENVIRONMENTS.make(
        config.env, config, clock or ClockConfig(), training=training
    )
    return env


for _game in GAMES:
    for _robot, _entry in ((True, "robot_env"), (False, "emulator_env")):
        gymnasium.register(
            env_id(_game, robot=_robot),
            f"viewer.terminal.rendering:{_entry}",
            kwargs={"game": _game},
        )
