"""What is played for show, and by whom: random actions, or a network that keeps its values."""

from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from annotated_types import Ge, Lt
from numpy.typing import NDArray

from actors.envs import make_env
from actors.envs.shown_env import ShownEnv
from actors.policy import Policy
from common.process.command_line import WeightsFile
from common.registry import ENVIRONMENTS
from common.run.clock import ClockConfig
from common.run.config import MAX_SEED, RunConfig
from common.run.fit import check_fit
from common.run.origin import origin_of
from common.run.own_settings import ENVIRONMENT, ROBOT
from common.run.presets import PRESETS
from common.run.rules import check_config, check_robot
from common.run.stored_config import flat

File = Annotated[Path | None, tyro.conf.arg(metavar="FILE")]
Network = Annotated[WeightsFile | None, tyro.conf.Positional, tyro.conf.arg(metavar="[FILE]")]
"""A network that is named without a flag, or none."""


def shown_env(config: RunConfig, clock: ClockConfig | None = None) -> closing[ShownEnv[Any, Any]]:
    """Returns a context of the environment of ``config``, whose episodes are whole games."""
    return closing(make_env(config, clock, training=False))


@dataclass(frozen=True)
class Played:
    """The flags that all commands share: the game, and who plays it."""

    env: str | None = None
    """Environment: 'robot' by default, 'ale', or a registered one."""
    game: str | None = None
    """Game: any that ale-py bundles; pong by default."""
    robot: str | None = None
    """Robot: 'nao' by default, 'robotroller', a registered one, or FILE.npz, a latency model of the
    hands."""
    robot_settings: Annotated[str | None, tyro.conf.arg(name="play.robot-settings")] = None
    """Settings that a robot declares for itself, such as 'rate=60' of a latency model."""
    env_settings: Annotated[str | None, tyro.conf.arg(name="play.env-settings")] = None
    """Settings that a registered environment declares for itself, such as 'lamps=4'."""
    seed: Annotated[int, Ge(0), Lt(MAX_SEED)] | None = None
    """Seed of the games and the random actions; by default that of the run's settings."""
    minimal_actions: Annotated[
        bool, tyro.conf.arg(name="play.minimal-actions", aliases=["--minimal-actions"])
    ] = False
    """Action set: the game's own actions (Pong: 6) instead of all 18."""

    def check(self) -> None:
        """Refuses flags that cannot work, before PyTorch is loaded, which takes seconds. Raises
        InputError that names the flag."""

    def config(self, weights: Path | None = None) -> RunConfig:
        """Returns the settings: those of the run of ``weights``, changed by the given flags.

        Without a run or a card, the robot plays Pong with all 18 actions. Raises InputError if the
        configuration in the run or the card cannot be read, or if the network does not fit the
        given flags.
        """
        trained = None if weights is None else origin_of(weights)
        config = trained
        if config is None:
            config = PRESETS[ENVIRONMENTS.find(self.env or RunConfig.env).preset]
            config = replace(config, play=replace(config.play, minimal_actions=False))
        given = {
            ENVIRONMENT.name: self.env,
            ENVIRONMENT.text: self.env_settings,
            ROBOT.name: self.robot,
            ROBOT.text: self.robot_settings,
        }
        play = replace(
            config.play,
            minimal_actions=self.minimal_actions or config.play.minimal_actions,
            robot=self.robot or config.play.robot,
            robot_settings=ROBOT.going_on(flat(config), given),
            env_settings=ENVIRONMENT.going_on(flat(config), given),
        )
        before = config
        config = replace(
            config.for_play,
            env=self.env or config.env,
            game=self.game or config.game,
            seed=config.seed if self.seed is None else self.seed,
            play=play,
        )
        check_config(config)
        check_robot(before, config)
        if weights is not None:
            check_fit(weights, trained, config)
        return config


class ShownPolicy(Policy):
    """A policy that keeps the values of the last state that it was asked about."""

    values: NDArray[np.float32] | None = None
    """Values of the last state, ``float32 [actions]``; None if all play is random."""

    def act(self, frames: NDArray[np.uint8], vectors: NDArray[np.float32]) -> NDArray[np.int64]:
        """Acts as `Policy.act` does, for one environment."""
        if self.epsilon < 1.0:
            self.values = self.q_values(frames, vectors)[0]
        return super().act(frames, vectors)
