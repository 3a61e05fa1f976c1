"""What Gymnasium calls to make an environment by its name."""

import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium

from actors.envs.ale import AtariEnv
from actors.envs.robot import RobotEnv
from actors.vision.layout import ASPECT
from ale_robot.arguments import check_settings
from common.errors import InputError
from common.registry import ENVIRONMENTS
from common.run.rules import check_chosen, check_play
from common.settings.clock import ClockConfig
from common.settings.config import RunConfig
from viewer.terminal.rendering import TerminalRendering


class EntryPoint:
    """Makes the environment ``name``, and draws it into the terminal for render_mode "human"."""

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 15}  # noqa: RUF012

    def __init__(
        self,
        name: str,
        env: Callable[..., gymnasium.Env[Any, Any]],
        aspect: float | None = None,
    ) -> None:
        self._name = name
        self._env = env
        self._aspect = aspect

    def __call__(
        self, *, render_mode: str | None = None, **settings: Any
    ) -> gymnasium.Env[Any, Any]:
        """Makes the environment.

        Raises:
            InputError: ``settings`` have no effect in this environment, or cannot work; or standard
                output is not a terminal, and render_mode is "human".
        """
        usual = RunConfig(env=self._name)
        known = {name: value for name, value in settings.items() if name in vars(usual)}
        kinds = {**{name: type(vars(usual)[name]) for name in known}, "clock": ClockConfig}
        for name, kind in kinds.items():
            if name in settings:
                check_settings(kind, settings[name], name)
        config = replace(usual, **known)
        if config.play.frame_stack == 1:  # a run's network needs two, but a wrapper may stack them
            config = replace(config, play=replace(config.play, frame_stack=2))
        check_play(config)
        check_chosen(usual, config)
        if "clock" in settings:
            if not ENVIRONMENTS.find(self._name).robot:
                raise InputError("clock is for the robot: the emulator alone has none, so omit it.")
            settings["clock"].check()
        discount = settings.get("discount", 1.0)
        if not (isinstance(discount, int | float) and 0 <= discount <= 1):
            raise InputError(f"discount is {discount!r}: choose from 0 to 1.")
        human = render_mode == "human"
        if human and (sys.stdout is None or not sys.stdout.isatty()):
            raise InputError(
                'render_mode "human" draws into the terminal, but standard output is not one: '
                'use "rgb_array".'
            )
        made = self._env(render_mode="rgb_array" if human else render_mode, **settings)
        return TerminalRendering(made, self._aspect) if human else made


robot_env = EntryPoint("robot", RobotEnv)
emulator_env = EntryPoint("ale", AtariEnv, ASPECT)
