"""What is played for show, and by whom: random actions, or a network that keeps its values."""

from contextlib import closing
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from numpy.typing import NDArray

from actors.envs import make_env
from actors.envs.shown_env import ShownEnv
from actors.envs.step_info import StepInfo
from actors.policy import Policy
from common.command_line.parser import WeightsFile
from common.counted import counted
from common.minus import points
from common.settings.clock import ClockConfig
from common.settings.config import RunConfig

File = Annotated[Path | None, tyro.conf.arg(metavar="FILE")]
Network = Annotated[WeightsFile | None, tyro.conf.Positional, tyro.conf.arg(metavar="[FILE]")]
"""A network that is named without a flag, or none."""


def shown_env(config: RunConfig, clock: ClockConfig | None = None) -> closing[ShownEnv[Any, Any]]:
    """Returns a context of the environment of ``config``, whose episodes are whole games."""
    return closing(make_env(config, clock, training=False))


def unfinished(info: StepInfo) -> str:
    """Returns the sentence about play in which no game ended, after its last step."""
    return (
        f"no game ended: score {points(info.game_score)} after {counted(info.game_steps, 'step')}"
    )


class ShownPolicy(Policy):
    """A policy that keeps the values of the last state that it was asked about."""

    values: NDArray[np.float32] | None = None
    """Values of the last state, ``float32 [actions]``; None if all play is random."""

    def act(self, frames: NDArray[np.uint8], vectors: NDArray[np.float32]) -> NDArray[np.int64]:
        """Acts as `Policy.act` does, for one environment."""
        chosen = super().act(frames, vectors)
        if self.epsilon < 1.0 and self.explored[0]:  # which asked for no values
            self.q_values(frames, vectors)
        return chosen

    def q_values(
        self, frames: NDArray[np.uint8], vectors: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Returns what `Policy.q_values` does, and keeps it."""
        values = super().q_values(frames, vectors)
        self.values = values[0]
        return values
