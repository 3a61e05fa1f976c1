"""ALE-Only: the agent at the emulator itself, without robot or camera (figure 2 of 2017)."""

from typing import Any, Self

import gymnasium
import numpy as np
from numpy.typing import NDArray

from actors.envs.actuation_delay import ActuationDelay
from actors.envs.emulator import Emulator
from actors.envs.game import DEFAULT_PLAY, AtariGame
from actors.envs.observation import FrameStack, Observation, observation_space, shrink
from actors.envs.proprioception import Proprioception
from actors.envs.step_info import StepInfo
from common.actions import KEYS_OF_ACTION, action_of_keys
from common.proprioception import KEY_FRAMES, vector_width
from common.run.clock import ClockConfig
from common.run.config import PlayConfig, RunConfig


class AtariEnv(gymnasium.Env[Observation, np.int64]):
    """One step is one agent step of ``play.frame_skip`` emulator frames.

    Observation: ``uint8 [frame_stack, 84, 84]``, newest frame last; with ``play.vector`` in a
    dictionary beside the last commands and keys. The keys are the commanded ones, unless ``play``
    has a command, release or press latency (`ActuationDelay`).
    Action: an index into all 18 actions, or into the game's own with ``play.minimal_actions``.
    Reward: points, not clipped.
    With ``training`` an episode also ends at a lost life, and the next ``reset()`` carries the
    same game on without touching the emulator. A ``reset()`` with a seed, with
    ``options={"new_game": True}`` or in the middle of an episode starts a new game.
    ``info`` is a `StepInfo`.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 15}  # noqa: RUF012

    def __init__(
        self,
        game: str = "pong",
        *,
        play: PlayConfig = DEFAULT_PLAY,
        training: bool = False,
        render_mode: str | None = None,
    ) -> None:
        """Raises InputError for a game that ale-py does not bundle."""
        self.metadata = {**self.metadata, "render_fps": 60 / play.frame_skip}
        self.render_mode = render_mode
        # An action that is held through all frames of an agent step the emulator can repeat itself.
        self._prompt = not (play.command_latency or play.release_latency or play.press_latency)
        skip = play.frame_skip if self._prompt else 1
        self._game = AtariGame(game, play, training=training, emulator_skip=skip)
        self._frame_skip = play.frame_skip
        self._keys = ActuationDelay(play)
        self._frames = FrameStack(play.frame_stack)
        self.action_space = gymnasium.spaces.Discrete(len(self._game.actions))
        self.observation_space = observation_space(play, vector_width(0))
        self._sense = Proprioception() if play.vector else None

    @classmethod
    def of_run(cls, config: RunConfig, clock: ClockConfig, *, training: bool) -> Self:
        """Returns the environment of a run; there is no robot whose ``clock`` could matter."""
        return cls(config.game, play=config.play, training=training)

    @property
    def emulator(self) -> Emulator:
        """The console; another one after a reset with a seed."""
        return self._game.emulator

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; its first state is its first frame, repeated."""
        super().reset(seed=seed)
        new = self._game.begin_episode(
            self.np_random,
            seeded=seed is not None,
            new_game=bool((options or {}).get("new_game", False)),
        )
        if new:
            self._keys.rest()
            if self._sense is not None:
                self._sense.forget()
        self._frames.restart(shrink(self._game.emulator.screen_grey()))
        return self._observation(), StepInfo(*self._game.standing, elapsed=0)._asdict()

    def step(self, action: np.int64 | int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Hold the action for one agent step."""
        command = self._game.action(action)
        wanted = KEYS_OF_ACTION[command]
        if self._sense is not None:
            self._sense.command(command)
        if self._prompt:
            pressed = [wanted] * self._frame_skip
            reward = self._game.hold(command)
        else:
            self._keys.command(wanted)
            pressed = [self._keys.step_frame() for _ in range(self._frame_skip)]
            reward = sum(self._game.hold(action_of_keys(keys)) for keys in pressed)
        if self._sense is not None:
            for keys in pressed[-KEY_FRAMES:]:
                self._sense.feel(keys)
        terminated, truncated = self._game.end_agent_step()
        self._frames.push(shrink(self._game.emulator.screen_grey()))
        info = StepInfo(*self._game.standing, keys_match=pressed[-1] == wanted)
        return self._observation(), reward, terminated, truncated, info._asdict()

    def render(self) -> NDArray[np.uint8] | None:
        """The emulator's screen, ``uint8 [rows, columns, 3]``, for render_mode "rgb_array"."""
        return self._game.emulator.screen_rgb() if self.render_mode == "rgb_array" else None

    def _observation(self) -> Observation:
        frames = self._frames.state
        if self._sense is None:
            return frames
        return {"frames": frames, "vector": self._sense.vector()}
