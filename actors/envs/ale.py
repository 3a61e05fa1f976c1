"""ALE-Only: the agent plays on the emulator itself, without robot or camera (figure 2 of 2017)."""

from dataclasses import replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from actors.envs.frame_camera import FrameCamera
from actors.envs.game import AtariGame
from actors.envs.game_env import GameEnv
from actors.envs.observation import Observation, shrink
from actors.envs.step_info import StepInfo
from actors.envs.world import World
from actors.robots.latency_model.model import LatencyModel
from common.settings.clock import ClockConfig
from common.settings.conditions import DEFAULT_PLAY, PERFECT_CAMERA, CameraConfig, PlayConfig
from common.settings.config import RunConfig
from common.settings.ranges import NOTHING_DRAWN, RandomiseConfig


class AtariEnv(GameEnv):
    """The emulator as an environment; a step is one agent step of ``play.frame_skip`` frames.

    Observation: ``uint8 [frame_stack, 84, 84]``, newest frame last. With ``play.vector`` it is a
    dictionary of these frames and the last commands and keys.
    Action: an index into all 18 actions, or into the game's own with ``play.minimal_actions``.
    Reward: points, not clipped.
    ``info``: a `StepInfo`.

    The pressed keys are the commanded ones, unless ``play`` gives the hand a latency (`hands_of`)
    or names a file that models it. The frame is the emulator's, unless ``camera`` has faults
    (`FrameCamera`).

    With ``training`` a lost life also ends an episode, and the next ``reset()`` continues the same
    game without touching the emulator. A ``reset()`` with a seed, with
    ``options={"new_game": True}`` or in the middle of an episode starts a new game.
    """

    def __init__(
        self,
        game: str = "pong",
        *,
        play: PlayConfig = DEFAULT_PLAY,
        camera: CameraConfig = PERFECT_CAMERA,
        randomise: RandomiseConfig = NOTHING_DRAWN,
        training: bool = False,
        render_mode: str | None = None,
    ) -> None:
        """Powers the console on.

        Args:
            randomise: ranges from which each game's conditions are drawn.

        Raises:
            InputError: ale-py does not bundle the game, or the file ``play.latency_model`` holds no
                latency model.
        """
        console = AtariGame(game, play, camera, randomise, training=training)
        self._model = LatencyModel.of_play(play) if play.latency_model else None
        # Only a robot's controller may be read once per agent step.
        world = World(self._model, console, replace(play, read_keys="frame"))
        super().__init__(console, world, play, render_mode)
        self._camera: FrameCamera | None = None

    @classmethod
    def of_run(cls, config: RunConfig, clock: ClockConfig, *, training: bool) -> Self:
        """Returns the environment of a run; there is no robot whose ``clock`` could matter."""
        return cls(
            config.game,
            play=config.play,
            camera=config.camera,
            randomise=config.randomise,
            training=training,
        )

    @property
    def seen(self) -> NDArray[np.uint8]:
        """The emulator's screen."""
        return self.emulator.screen_rgb()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode, whose first state repeats its first frame."""
        if self._begin_episode(seed, options):
            play, camera, copy = self.conditions
            if self._model is not None:
                self._model.take_copy(copy)
            self._world.begin_game(play, self.np_random)
            self._camera = None
            if camera != PERFECT_CAMERA:
                self._camera = FrameCamera(camera)
                self._camera.begin_game(self.np_random)
                self._time_eye(self._camera.measure_latency)
        self._frames.restart(self._frame(0))
        return self._observation(), StepInfo(*self._game.standing, elapsed=0)._asdict()

    def step(self, action: np.int64 | int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Holds the action for one agent step."""
        self._world.command(self._game.action(action))
        done = self._world.finish_agent_step()
        self._frames.push(self._frame(1))
        info = StepInfo(*self._game.standing, keys_match=done.pressed == self.wanted)._asdict()
        return self._observation(), done.points, done.terminated, done.truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """Returns the emulator's screen, ``uint8 [rows, columns, 3]``; None unless render_mode is
        "rgb_array"."""
        return self.seen if self.render_mode == "rgb_array" else None

    def _frame(self, agent_steps: int) -> NDArray[np.uint8]:
        screen = self.emulator.screen_grey()
        return shrink(screen) if self._camera is None else self._camera.take(screen, agent_steps)
