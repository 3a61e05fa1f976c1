"""`GameEnv`: what `AtariEnv` and `RobotEnv` share."""

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.envs.emulator import Emulator
from actors.envs.game import AtariGame
from actors.envs.observation import FrameStack, Observation, observation_space
from actors.envs.shown_env import ShownEnv
from actors.envs.world import World
from common.actions import Keys
from common.settings.conditions import Conditions, PlayConfig


class GameEnv(ShownEnv[Observation, np.int64]):
    """An environment of an `AtariGame` in a `World`: its spaces, episodes and conditions.

    A subclass decides whose hands play the game, how its time passes and how it is seen.

    Args:
        joints: number of the robot's joints; 0 without a robot.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 15}  # noqa: RUF012

    def __init__(
        self,
        game: AtariGame,
        world: World,
        play: PlayConfig,
        render_mode: str | None,
        joints: int = 0,
    ) -> None:
        self.metadata = {**self.metadata, "render_fps": play.steps_per_second}
        self.render_mode = render_mode
        self._game = game
        self._world = world
        self._play = play
        self._frames = FrameStack(play.frame_stack)
        self.action_space = gymnasium.spaces.Discrete(len(game.actions))
        self.observation_space = observation_space(play, joints)

    @property
    def conditions(self) -> Conditions:
        """The conditions of the present game."""
        return self._game.conditions

    @property
    def emulator(self) -> Emulator:
        """The console; a reset with a seed replaces it."""
        return self._game.emulator

    @property
    def task(self) -> str:
        """The game."""
        return self.emulator.game

    @property
    def actions(self) -> tuple[int, ...]:
        """ALE's numbers of the actions on offer."""
        return self._game.actions

    def ram(self) -> NDArray[np.uint8]:
        """Returns the console's present memory, ``uint8 [128]``."""
        with self.still():
            return self.emulator.ram()

    @property
    def wanted(self) -> Keys:
        return self._world.wanted

    @property
    def pressed(self) -> Keys:
        return self._world.pressed

    def _begin_episode(self, seed: int | None, options: dict[str, Any] | None) -> bool:
        """Begins an episode with the arguments of ``reset``; returns whether its game is new."""
        super().reset(seed=seed)
        seeded = seed is not None
        return self._game.begin_episode(self.np_random, seeded=seeded, options=options or {})

    def _time_eye(self, latency: Callable[[Generator], int]) -> None:
        """With ``play.equal_latency``, makes hands and eye equally late.

        Call it before the first command of a game, which is already timed by that.

        Args:
            latency: returns the eye's latency in agent steps, from the game's generator.
        """
        if self._play.equal_latency:
            self._world.see_late(latency(self.np_random) * self._play.frame_skip)

    def _observation(self) -> Observation:
        frames, vector = self._frames.state, self._world.vector()
        return frames if vector is None else {"frames": frames, "vector": vector}
