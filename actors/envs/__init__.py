"""The environments an actor plays in."""

from typing import Any

from actors.envs.shown_env import ShownEnv
from common.registry import ENVIRONMENTS
from common.settings.clock import ClockConfig
from common.settings.config import RunConfig


def make_env(
    config: RunConfig, clock: ClockConfig | None = None, *, training: bool
) -> ShownEnv[Any, Any]:
    """Returns the environment of a run, by its name in `common.registry.ENVIRONMENTS`.

    Args:
        clock: how time passes in a robot's world; lockstep by default.
        training: whether a lost life ends an episode.

    Raises:
        InputError: there is no such environment, robot or game; or the environment is of another
            package, and has other actions than its entry.
    """
    # Imported late: `StepInfo`, which lives beside them, needs no emulator.
    from actors.envs.checked import CheckedEnv
    from actors.envs.game_env import GameEnv

    env = ENVIRONMENTS.make(config.env, config, clock or ClockConfig(), training=training)
    return env if isinstance(env, GameEnv) else CheckedEnv(env, config)
