"""What Gymnasium calls to make an environment by its name."""

import sys
from collections.abc import Callable
from typing import Any

import gymnasium

from actors.envs.ale import AtariEnv
from actors.envs.robot import RobotEnv
from actors.vision.layout import ASPECT
from common.errors import InputError
from viewer.terminal.rendering import TerminalRendering


class EntryPoint:
    """Makes an environment, and draws it into the terminal for render_mode "human"."""

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 15}  # noqa: RUF012

    def __init__(
        self, env: Callable[..., gymnasium.Env[Any, Any]], aspect: float | None = None
    ) -> None:
        self._env = env
        self._aspect = aspect

    def __call__(
        self, *, render_mode: str | None = None, **settings: Any
    ) -> gymnasium.Env[Any, Any]:
        """Makes the environment. Raises InputError for render_mode "human" if standard output is
        not a terminal."""
        human = render_mode == "human"
        if human and (sys.stdout is None or not sys.stdout.isatty()):
            raise InputError(
                'render_mode "human" draws into the terminal, but standard output is not one: '
                'use "rgb_array".'
            )
        made = self._env(render_mode="rgb_array" if human else render_mode, **settings)
        return TerminalRendering(made, self._aspect) if human else made


robot_env = EntryPoint(RobotEnv)
emulator_env = EntryPoint(AtariEnv, ASPECT)
