"""The public API of ALE-Robot: Gymnasium environments, trained policies, evaluations.

Importing it registers two environments per game with Gymnasium: ``ALERobot/<Game>-v0``, the robot,
and ``ALERobot/<Game>-Emulator-v0``, the emulator alone::

    import ale_robot, gymnasium

    env = gymnasium.make("ALERobot/Pong-v0")
    policy = ale_robot.load_policy("robot_pong")  # plays in policy.make_env()
    ale_robot.evaluate("robot_pong", games=5)["mean"]
"""

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ale_robot.policy import TrainedPolicy, evaluate, load_policy
    from common.errors import InputError
    from common.settings.clock import ClockConfig
    from common.settings.conditions import CameraConfig, PlayConfig
    from common.settings.ranges import RandomiseConfig

__all__ = [
    "CameraConfig",
    "ClockConfig",
    "InputError",
    "PlayConfig",
    "RandomiseConfig",
    "TrainedPolicy",
    "__version__",
    "env_id",
    "evaluate",
    "load_policy",
]

for _name in ("actors", "common", "deploy", "learner", "replay", "viewer"):
    _found = find_spec(_name)
    _file = Path((_found and _found.origin) or _name).resolve()
    if _file.parent.parent != Path(__file__).resolve().parents[1]:
        raise ImportError(
            f"{_file.parent} hides the package {_name} of ale-robot: run it in another folder."
        )

_by_module = sys.orig_argv[1:3] == ["-m", "ale_robot"]
if _by_module or Path(sys.argv[0]).name == "ale-robot":  # the imports below precede its `main`
    from common.process.lifeline import leave_at_interrupt

    leave_at_interrupt()

from ale_robot.environments import env_id  # noqa: E402
from common.version import VERSION as __version__  # noqa: E402

_ELSEWHERE = {
    "CameraConfig": "common.settings.conditions",
    "ClockConfig": "common.settings.clock",
    "InputError": "common.errors",
    "PlayConfig": "common.settings.conditions",
    "RandomiseConfig": "common.settings.ranges",
}
"""Modules of the public names that are not those of `ale_robot.policy`."""


def __getattr__(name: str) -> Any:
    """Loads on first use the names that take long to import."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_ELSEWHERE.get(name, "ale_robot.policy")), name)


def __dir__() -> list[str]:
    """Returns the public names, loaded or not, for tab completion."""
    return __all__
