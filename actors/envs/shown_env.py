"""`ShownEnv`: all that viewers know of an environment, whoever made it."""

from abc import abstractmethod
from contextlib import AbstractContextManager, nullcontext

import gymnasium
import numpy as np
from gymnasium.core import ActType, ObsType
from numpy.typing import NDArray

from common.actions import Keys


class ShownEnv(gymnasium.Env[ObsType, ActType]):
    """An environment that can be watched and filmed."""

    @property
    def rate(self) -> float:
        """Agent steps in a second of play."""
        return float(self.metadata["render_fps"])

    @property
    @abstractmethod
    def task(self) -> str:
        """What is played: a game, or the environment itself if it has none."""

    @property
    @abstractmethod
    def actions(self) -> tuple[int | None, ...]:
        """ALE's numbers of the actions on offer; None for an action that is not ALE's."""

    @property
    @abstractmethod
    def seen(self) -> NDArray[np.uint8]:
        """The picture of the last state, ``uint8 [rows, columns, 3]``, to be shown 4:3."""

    def still(self) -> AbstractContextManager[object]:
        """Returns a context in which the world stands still, so that it can be looked at."""
        return nullcontext()

    def paused(self) -> AbstractContextManager[object]:
        """Returns a context for a wait between two steps, in which no game time passes."""
        return nullcontext()

    @property
    def wanted(self) -> Keys:
        """The keys of the last action."""
        return Keys.NONE

    @property
    def pressed(self) -> Keys:
        """The keys that the game got last."""
        return Keys.NONE
