"""`GameEnv`: what `AtariEnv` and `RobotEnv` share, and what the viewers know of either."""

from abc import abstractmethod
from typing import Any

import gymnasium
import numpy as np

from actors.envs.emulator import Emulator
from actors.envs.game import AtariGame
from actors.envs.observation import FrameStack, Observation, observation_space
from common.actions import Keys
from common.run.conditions import Conditions, PlayConfig


class GameEnv(gymnasium.Env[Observation, np.int64]):
    """An environment of an `AtariGame`, with the spaces, episodes and conditions of that game.

    A subclass decides how keys are pressed and how the game is seen.

    Args:
        joints: of the robot; 0 without one.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 15}  # noqa: RUF012

    def __init__(
        self, game: AtariGame, play: PlayConfig, render_mode: str | None, joints: int = 0
    ) -> None:
        self.metadata = {**self.metadata, "render_fps": 60 / play.frame_skip}
        self.render_mode = render_mode
        self._game = game
        self._play = play
        self._frames = FrameStack(play.frame_stack)
        self.action_space = gymnasium.spaces.Discrete(len(game.actions))
        self.observation_space = observation_space(play, joints)

    @property
    def conditions(self) -> Conditions:
        """Those of the present game."""
        return self._game.conditions

    @property
    def emulator(self) -> Emulator:
        """The console; another one after a reset with a seed."""
        return self._game.emulator

    @property
    def actions(self) -> tuple[int, ...]:
        """ALE's numbers of the actions on offer."""
        return self._game.actions

    @property
    @abstractmethod
    def wanted(self) -> Keys:
        """The keys of the last action."""

    @property
    @abstractmethod
    def pressed(self) -> Keys:
        """The keys that the game was given last."""

    def _begin_episode(self, seed: int | None, options: dict[str, Any] | None) -> bool:
        """Begins an episode by the arguments of ``reset``; returns whether it is of a new game."""
        super().reset(seed=seed)
        seeded = seed is not None
        return self._game.begin_episode(self.np_random, seeded=seeded, options=options or {})
