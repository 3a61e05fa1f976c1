"""Checks what an environment of another package gives, because the replay would store wrong states
in silence; and shows it."""

import math
from contextlib import AbstractContextManager
from numbers import Real
from typing import Any, SupportsFloat

import cv2
import gymnasium
import numpy as np
from numpy.typing import NDArray

from actors.envs.observation import frames_and_vector
from actors.envs.shown_env import ShownEnv
from actors.envs.step_info import StepInfo
from actors.vision.layout import ASPECT
from common.checked import MAX_SIZE
from common.errors import InputError
from common.protocol.step_fields import FRAME_SHAPE, MAX_ELAPSED
from common.registry import foreign
from common.settings.config import RunConfig

_MARGIN = 32
"""Grey of the margins around a picture that is not 4:3; black may be the picture's own."""


class CheckedEnv(gymnasium.Wrapper[Any, Any, Any, Any], ShownEnv[Any, Any]):
    """An environment whose actions and observations are as the run's settings say.

    The replay keeps the newest frame of each state, and puts the states together again. So a state
    has to be the frames of the state before without the oldest, and a new one; the first state of
    an episode repeats its only frame.

    Raises:
        InputError: its actions are not those of the settings, or its rate is not a positive
            number. From `reset` and `step`: it fails, or a state is malformed. From `seen`: it
            cannot render, or the picture is malformed.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], config: RunConfig) -> None:
        super().__init__(env)
        self._name = f"the environment {config.env}"
        self._task = config.task
        self._shape = (config.play.frame_stack, *FRAME_SHAPE)
        self._width = config.vector_width
        self._frames: NDArray[np.uint8]
        rate = env.metadata.get("render_fps")
        if rate is None:
            rate = config.play.steps_per_second
        if not isinstance(rate, Real) or not 0 < float(rate) < math.inf:
            raise InputError(
                f"{self._name} has the render_fps {rate!r}: give the agent steps in a second of "
                "play, more than 0."
            )
        self.metadata = {**env.metadata, "render_fps": rate}
        actions = gymnasium.spaces.Discrete(config.action_count)
        found = getattr(env, "action_space", None)  # Gymnasium declares it and sets none
        if found != actions:
            raise InputError(
                f"{self._name} has the actions {found}, and its entry says {actions.n}: make them "
                "equal."
            )
        self._actions = (None,) * config.action_count

    @property
    def task(self) -> str:
        return self._task

    @property
    def actions(self) -> tuple[None, ...]:
        return self._actions

    @property
    def seen(self) -> NDArray[np.uint8]:
        """What it renders in the render mode "rgb_array"; in another one, its newest frame. Grey
        margins keep the shape."""
        if self.render_mode == "rgb_array":
            with foreign(f"render() of {self._name}"):
                rendered: Any = self.env.render()
        else:
            rendered = cv2.cvtColor(self._frames[-1], cv2.COLOR_GRAY2RGB)
        picture = np.asarray(rendered)
        if picture.dtype != np.uint8 or picture.shape[2:] != (3,) or not picture.size:
            told = f"{picture.dtype} {list(picture.shape)}" if picture.ndim else rendered
            raise InputError(f"{self._name} renders {told}: give uint8 [rows, columns, 3].")
        rows, columns = picture.shape[:2]
        high, wide = max(rows, round(columns / ASPECT)), max(columns, round(rows * ASPECT))
        margins = [(more // 2, more - more // 2) for more in (high - rows, wide - columns)]
        return np.pad(picture, [*margins, (0, 0)], constant_values=_MARGIN)

    def still(self) -> AbstractContextManager[object]:
        inner = self.unwrapped
        return inner.still() if isinstance(inner, ShownEnv) else super().still()

    def paused(self) -> AbstractContextManager[object]:
        inner = self.unwrapped
        return inner.paused() if isinstance(inner, ShownEnv) else super().paused()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        with foreign(f"reset() of {self._name}"):
            observation, info = self.env.reset(seed=seed, options=options)
            frames = self._checked(observation)
            StepInfo.of(info)
        if (frames != frames[-1]).any():
            raise InputError(
                f"{self._name} begins an episode with frames that differ: repeat the first one, as "
                "the replay will."
            )
        return observation, info

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        with foreign(f"step() of {self._name}"):
            observation, reward, terminated, truncated, info = self.env.step(action)
            before, frames = self._frames, self._checked(observation)
            told = StepInfo.of(info)
            numbers = {"reward": float(reward), "score": told.game_score}
        if (frames[:-1] != before[1:]).any():
            raise InputError(
                f"{self._name} changes older frames of a state: keep them and append the new one, "
                "as the replay will."
            )
        for what, number in numbers.items():
            if not abs(number) <= MAX_SIZE:  # nor NaN
                raise InputError(
                    f"{self._name} gives the {what} {number}: give a number within ±{MAX_SIZE:g}."
                )
        if not 1 <= told.elapsed <= MAX_ELAPSED:
            raise InputError(
                f"{self._name} says that a step took {told.elapsed} agent steps: give 1 to "
                f"{MAX_ELAPSED}; 0 is for a reset."
            )
        if told.game_over and not (terminated or truncated):
            raise InputError(
                f"{self._name} goes on after a game is over: let that step be terminated or "
                "truncated."
            )
        # If a time limit passes as the episode ends, Gymnasium's wrapper says both. It has ended.
        if cut := truncated and not terminated:
            info = {**info, "game_over": True}  # of games that wrapper does not know
        return observation, reward, terminated, cut, info

    def _checked(self, observation: Any) -> NDArray[np.uint8]:
        frames, vector = frames_and_vector(observation)
        if frames.dtype != np.uint8 or frames.shape != self._shape:
            raise InputError(
                f"{self._name} gives frames {frames.dtype} {list(frames.shape)}: give uint8 "
                f"{list(self._shape)}."
            )
        if vector.shape != (self._width,):
            raise InputError(
                f"{self._name} gives a vector {list(vector.shape)}, and the settings say "
                f"[{self._width}]: give that one, or change --play.vector."
            )
        if not (np.abs(vector) <= MAX_SIZE).all():
            raise InputError(
                f"{self._name} gives a vector with a number that is not within ±{MAX_SIZE:g}: "
                "scale it, best to -1 to 1."
            )
        self._frames = frames.copy()  # an environment may reuse its array
        return self._frames
