"""Trained policies: loads them with the settings of their training, plays them, evaluates them."""

import threading
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from actors.envs import make_env
from actors.envs.game_env import GameEnv
from actors.envs.observation import NO_VECTOR, Observation
from actors.policy import Policy
from ale_robot.arguments import check_argument, check_settings
from common.checked import Count, Fraction, FromOne
from common.command_line.played import playing_settings
from common.errors import InputError
from common.protocol.step_fields import FRAME_SHAPE
from common.run.origin import find_weights, name_of, trained_settings
from common.run.rules import check_chosen, check_play
from common.settings.clock import ClockConfig
from common.settings.conditions import CameraConfig, PlayConfig
from common.settings.config import RunConfig, Seed
from common.settings.fit import as_argument, check_fit
from common.settings.ranges import RandomiseConfig
from learner.evaluation import offline
from learner.evaluation.options import EPSILON, GAMES, EvaluationOptions

if TYPE_CHECKING:
    import torch


class TrainedPolicy:
    """A network and the settings that it was trained under; it plays ε-greedily.

    Args:
        weights: a file, or the name of a shipped policy, such as "robot_pong".
        epsilon: share of random actions.
        seed: seed of the random actions.

    Raises:
        InputError: there is no such network, it cannot be read, or an argument is out of bounds.
    """

    def __init__(
        self, weights: "str | Path | TrainedPolicy", *, epsilon: float = 0.0, seed: int = 1
    ) -> None:
        epsilon = check_argument(Fraction, epsilon, "epsilon")
        seed = check_argument(Seed, seed, "seed")
        self.weights = _file_of(weights)
        self.config = playing_settings(self.weights)
        self._policy = Policy.of_file(self.config, self.weights, epsilon, seed)

    def __repr__(self) -> str:
        return f"TrainedPolicy({name_of(self.weights)!r}), trained to play {self.config.played}"

    def make_env(
        self,
        *,
        env: str | None = None,
        game: str | None = None,
        play: PlayConfig | None = None,
        camera: CameraConfig | None = None,
        randomise: RandomiseConfig | None = None,
        clock: ClockConfig | None = None,
    ) -> gymnasium.Env[Any, Any]:
        """Returns an environment whose episodes are whole games, and whose ``render`` returns the
        room from outside, or the emulator's screen.

        Args:
            env: environment instead of that of its training, such as "robot" or "ale".
            game: game instead of that of its training.
            play: settings instead of those of its training, ``config.play``.
            camera: settings instead of those of its training, ``config.camera``.
            randomise: ranges from which each game draws its conditions; none by default.
            clock: how time passes for a robot; lockstep by default.

        Raises:
            InputError: the settings cannot work, or the network does not fit them.
        """
        settings = {"play": play, "camera": camera, "randomise": randomise}
        config = _changed(self.weights, self.config, env=env, game=game, **settings)
        made = make_env(config, _checked(clock, config), training=False)
        if isinstance(made, GameEnv):
            made.render_mode = "rgb_array"
        return made

    def act(self, observation: Observation) -> int:
        """Returns the index of an action, for an observation of `make_env`. Raises InputError if it
        is another environment's."""
        return int(self._policy.act(*self._batch(observation))[0])

    def q_values(self, observation: Observation) -> NDArray[np.float32]:
        """Returns the value of each action, ``float32 [actions]``. Raises InputError as `act`."""
        values: NDArray[np.float32] = self._policy.q_values(*self._batch(observation))[0]
        return values

    @property
    def network(self) -> "torch.nn.Module":
        """The network, which maps frames ``uint8 [batch, frame_stack, 84, 84]``, newest last, and
        vectors ``float32 [batch, P]`` (P is 0 without ``config.play.vector``) to Q-values
        ``float32 [batch, actions]``. ``torch.export`` takes it as it is."""
        return self._policy.network

    def _batch(self, observation: Observation) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        told: dict[str, Any]
        told = {**observation} if isinstance(observation, dict) else {"frames": observation}
        try:
            frames = np.asarray(told.get("frames", NO_VECTOR))
            vector = np.asarray(told.get("vector", NO_VECTOR), np.float32)
        except (TypeError, ValueError, RuntimeError) as error:
            raise InputError(f"the observation's parts are no numbers: {error}.") from None
        found = str(frames.dtype), frames.shape, vector.shape
        stack = (self.config.play.frame_stack, *FRAME_SHAPE)
        if found != ("uint8", stack, (self.config.vector_width,)):
            raise InputError(
                f"the policy takes frames of uint8 {stack} and a vector of "
                f"{self.config.vector_width} numbers, and got {found[0]} {found[1]} and "
                f"{found[2]}: give it the whole observation of its own make_env()."
            )
        if not np.isfinite(vector).all():
            raise InputError("the observation's vector has numbers that are not finite.")
        return frames[None], vector[None]


load_policy = TrainedPolicy


def evaluate(
    weights: str | Path | TrainedPolicy,
    *,
    games: int = GAMES,
    epsilon: float = EPSILON,
    seed: int = 1,
    processes: int = 0,
    env: str | None = None,
    game: str | None = None,
    play: PlayConfig | None = None,
    camera: CameraConfig | None = None,
    randomise: RandomiseConfig | None = None,
    clock: ClockConfig | None = None,
) -> dict[str, Any]:
    """Plays whole games in several processes, as ``ale-robot evaluate`` does.

    Args:
        weights: a policy, its file, or the name of a shipped one.
        processes: number of games played at the same time; 0 for as many as there are cores.
        env: environment instead of that of its training, such as "robot" or "ale".
        game: game instead of that of its training.
        play: settings instead of those of its training, ``load_policy(weights).config.play``.
        camera: settings instead of those of its training.
        randomise: ranges from which each game draws its conditions; none by default.
        clock: how time passes for a robot; lockstep by default.

    Returns:
        What ``ale-robot evaluate --json`` writes: "mean", "deviation", "iqm", "scores", …

    Raises:
        InputError: there is no such network, or the settings of its training are unknown; an
            argument is out of bounds, the given settings cannot work, or the network does not fit
            them.
    """
    file = _file_of(weights)
    trained = trained_settings(file)
    seed = check_argument(Seed, seed, "seed")
    options = EvaluationOptions(
        games=check_argument(FromOne, games, "games"),
        epsilon=check_argument(Fraction, epsilon, "epsilon"),
        processes=check_argument(Count, processes, "processes"),
    )
    settings = {"play": play, "camera": camera, "randomise": randomise}
    config = _changed(file, trained.for_play, env=env, game=game, **settings)
    found = offline.evaluate(
        file,
        options,
        replace(config, seed=seed),
        _checked(clock, config),
        threading.Event(),
        Console(quiet=True),
    )
    assert found is not None  # nobody stops it
    return found


def _file_of(weights: object) -> Path:
    """Returns the file of a policy's weights. Raises InputError if there is none."""
    if isinstance(weights, TrainedPolicy):
        return weights.weights
    if not isinstance(weights, str | Path):
        raise InputError(f"weights is {weights!r}: give a policy, its file, or its name.")
    return find_weights(weights)


def _checked(clock: ClockConfig | None, config: RunConfig) -> ClockConfig:
    """Returns ``clock``, or lockstep. Raises InputError if it cannot work under ``config``."""
    if clock is None:
        return ClockConfig()
    check_settings(ClockConfig, clock, "clock")
    clock.check(config.env)
    return clock


_KINDS = {"play": PlayConfig, "camera": CameraConfig, "randomise": RandomiseConfig}


def _changed(weights: Path, config: RunConfig, **given: Any) -> RunConfig:
    """Returns ``config`` with those settings that are given, not None."""
    for name, kind in _KINDS.items():
        if given[name] is not None:
            check_settings(kind, given[name], name)
    changed = replace(config, **{name: each for name, each in given.items() if each is not None})
    if changed != config:
        check_play(changed)
        check_chosen(config, changed)
        check_fit(weights, config, changed, written=as_argument)
    return changed.pinned()
