"""Gymnasium's names of the environments, two for every game: the robot, and the emulator alone.

What makes them is named as text, so that PyBullet and OpenCV are loaded only where they are used.
"""

import gymnasium

from common.games import GAMES


def env_id(game: str, *, robot: bool) -> str:
    """Returns Gymnasium's name of a game: ``ALERobot/SpaceInvaders-v0`` for space_invaders."""
    name = "".join(part.title() for part in game.split("_"))
    return f"ALERobot/{name}-v0" if robot else f"ALERobot/{name}-Emulator-v0"


for _game in GAMES:
    for _robot, _entry in ((True, "robot_env"), (False, "emulator_env")):
        gymnasium.register(
            env_id(_game, robot=_robot),
            f"ale_robot.entry_points:{_entry}",
            kwargs={"game": _game},
        )
