"""Checks what an environment of another package gives: the replay would store wrong states in
silence."""

from typing import Any, SupportsFloat

import gymnasium
import numpy as np
from numpy.typing import NDArray

from actors.loop import frames_and_vector
from common.errors import InputError
from common.protocol.step_fields import FRAME_SHAPE
from common.run.config import RunConfig


class CheckedEnv(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment whose actions and observations are as the run's settings say.

    The replay keeps the newest frame of each state, and puts the states together again. So a state
    has to be the frames of the state before without the oldest, and a new one; the first state of
    an episode repeats its only frame.

    Making it raises InputError if the actions are otherwise; `reset` and `step`, if a state is.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], config: RunConfig) -> None:
        super().__init__(env)
        self._name = f"the environment {config.env}"
        self._shape = (config.play.frame_stack, *FRAME_SHAPE)
        self._width = config.vector_width
        self._frames: NDArray[np.uint8]
        actions = gymnasium.spaces.Discrete(config.action_count)
        found = getattr(env, "action_space", None)  # Gymnasium declares it and sets none
        if found != actions:
            raise InputError(
                f"{self._name} has the actions {found}, and its entry says {actions.n}: make them "
                "equal."
            )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(seed=seed, options=options)
        frames = self._checked(observation)
        if (frames != frames[-1]).any():
            raise InputError(
                f"{self._name} begins an episode with frames that differ: repeat the first one, as "
                "the replay will."
            )
        return observation, info

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        before = self._frames
        observation, *rest = self.env.step(action)
        if (self._checked(observation)[:-1] != before[1:]).any():
            raise InputError(
                f"{self._name} changes older frames of a state: keep them and append the new one, "
                "as the replay will."
            )
        return observation, *rest

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
        self._frames = frames.copy()  # an environment may reuse its array
        return self._frames
