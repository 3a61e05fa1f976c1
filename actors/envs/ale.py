"""ALE-Only: the agent at the emulator itself, without robot or camera (figure 2 of 2017)."""

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from actors.envs.frame_camera import FrameCamera
from actors.envs.game import DEFAULT_PLAY, AtariGame
from actors.envs.game_env import GameEnv
from actors.envs.late_commands import are_prompt, hands_of
from actors.envs.observation import Observation, shrink
from actors.envs.proprioception import Proprioception
from actors.envs.step_info import StepInfo
from actors.robots.latency_model.model import LatencyModel
from common.actions import KEYS_OF_ACTION, Keys, action_of_keys
from common.run.clock import ClockConfig
from common.run.conditions import (
    NOTHING_DRAWN,
    PERFECT_CAMERA,
    CameraConfig,
    PlayConfig,
    RandomiseConfig,
)
from common.run.config import RunConfig


class AtariEnv(GameEnv):
    """One step is one agent step of ``play.frame_skip`` emulator frames.

    Observation: ``uint8 [frame_stack, 84, 84]``, newest frame last; with ``play.vector`` in a
    dictionary beside the last commands and keys. The keys are the commanded ones, unless ``play``
    gives the hand a latency (`hands_of`) or models it by a file; the frame is the emulator's,
    unless ``camera`` has faults (`FrameCamera`).
    Action: an index into all 18 actions, or into the game's own with ``play.minimal_actions``.
    Reward: points, not clipped.
    With ``training`` an episode also ends at a lost life, and the next ``reset()`` carries the
    same game on without touching the emulator. A ``reset()`` with a seed, with
    ``options={"new_game": True}`` or in the middle of an episode starts a new game.
    ``info`` is a `StepInfo`.
    """

    wanted = pressed = Keys.NONE

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
        """Power the console on.

        Args:
            randomise: ranges of the conditions that are drawn for each game.

        Raises:
            InputError: ale-py does not bundle the game, or a file holds no latency model.
        """
        # An action that is held through all frames of an agent step the emulator can repeat itself.
        self._prompt = are_prompt(play) and randomise.latency == randomise.jitter == 0
        skip = play.frame_skip if self._prompt else 1
        super().__init__(
            AtariGame(game, play, camera, randomise, training=training, emulator_skip=skip),
            *(play, render_mode),
        )
        self._model = LatencyModel.of_file(play.latency_model) if play.latency_model else None
        self._hands = hands_of(play, self._model, np.random.default_rng(0))
        self._camera: FrameCamera | None = None
        self._sense = Proprioception(play) if play.vector else None

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

    def ram(self) -> NDArray[np.uint8]:
        """Returns the console's memory, ``uint8 [128]``."""
        return self._game.emulator.ram()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; its first state is its first frame, repeated."""
        if self._begin_episode(seed, options):
            play, camera = self.conditions
            self._hands = hands_of(play, self._model, self.np_random)
            self._hands.rest()
            self.wanted = self.pressed = Keys.NONE
            perfect = camera == PERFECT_CAMERA
            self._camera = None if perfect else FrameCamera(camera, self.np_random)
            if self._sense is not None:
                self._sense.forget()
        self._frames.restart(self._frame(0))
        return self._observation(), StepInfo(*self._game.standing, elapsed=0)._asdict()

    def step(self, action: np.int64 | int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Hold the action for one agent step."""
        command = self._game.action(action)
        wanted = KEYS_OF_ACTION[command]
        if self._sense is not None:
            self._sense.command(command)
        if self._prompt:
            pressed = [wanted] * self._play.frame_skip
            reward = self._game.hold(command)
        else:
            self._hands.command(wanted)
            pressed = [self._hands.step_frame() for _ in range(self._play.frame_skip)]
            reward = sum(self._game.hold(action_of_keys(keys)) for keys in pressed)
        if self._sense is not None:
            for keys in pressed:
                self._sense.feel(keys)
        self.wanted, self.pressed = wanted, pressed[-1]
        terminated, truncated = self._game.end_agent_step()
        self._frames.push(self._frame(1))
        info = StepInfo(*self._game.standing, keys_match=pressed[-1] == wanted)
        return self._observation(), reward, terminated, truncated, info._asdict()

    def render(self) -> NDArray[np.uint8] | None:
        """The emulator's screen, ``uint8 [rows, columns, 3]``, for render_mode "rgb_array"."""
        return self._game.emulator.screen_rgb() if self.render_mode == "rgb_array" else None

    def _frame(self, agent_steps: int) -> NDArray[np.uint8]:
        screen = self._game.emulator.screen_grey()
        return shrink(screen) if self._camera is None else self._camera.take(screen, agent_steps)

    def _observation(self) -> Observation:
        frames = self._frames.state
        if self._sense is None:
            return frames
        return {"frames": frames, "vector": self._sense.vector()}
