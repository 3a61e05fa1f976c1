"""`python -m benchmarks.lab.equal_hands`: how alike ``--play.equal-latency`` makes a robot's hands.

Random commands of a game's own actions go to the robot's hands and to hands that keep the schedule
in every frame. A policy that learned with the one plays by the other as well as the keys of both
agree. Each row has its own time between two new commands.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, MinLen
from numpy.typing import NDArray

from actors.envs.command_plan import CommandPlan
from actors.envs.hands import hands_of
from actors.envs.latency_equaliser import LatencyEqualiser
from actors.robots.interface import Hands
from actors.robots.latency import hold
from actors.robots.latency_model.fit import commands
from actors.robots.latency_model.weights import check_one_copy
from benchmarks.report import BenchmarkOptions, Numbers, Report, main
from common.actions import KEYS_OF_ACTION, Keys
from common.checked import FromOne
from common.games import MINIMAL_ACTIONS, SCREEN_SHAPE, check_game
from common.registry import ROBOTS
from common.settings.conditions import (
    MAX_ADDED,
    MAX_GAP,
    CameraConfig,
    LatencyModelSettings,
    PlayConfig,
)

_TOLD = ("latency", "gap", "model_rate", "hands_model", "game", "steps", "seed")


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Measure in how many emulator frames a robot's hands hold other keys than the schedule of
    equal hands says."""

    robots: Annotated[tuple[str, ...], MinLen(1)] = ("nao", "robotroller")
    """Robots, or files of latency models, whose hands are measured."""
    latency: Annotated[int, Ge(1), Le(MAX_ADDED)] = 16
    """Latency of the schedule, emulator frames (--play.equal-latency); hands that need longer stay
    later."""
    gap: Annotated[int, Ge(0), Le(MAX_GAP)] = 0
    """Gap of the schedule between two keys, emulator frames (--play.equal-gap)."""
    model_rate: Literal[30, 60] = LatencyModelSettings.rate
    """Commands that a latency model takes per second."""
    hands_model: str = ""
    """File of a latency model by which commands are planned (--play.hands-model)."""
    game: str = "pong"
    """Game whose own actions are commanded."""
    steps: FromOne = 5_000
    """Number of agent steps of each measurement."""
    every: Numbers = (1, 3, 12)
    """Mean numbers of agent steps between two random commands, one for each row."""
    seed: Annotated[int, Ge(0)] = 1
    """Seed of the commands."""

    def check(self) -> None:
        super().check()
        check_game(self.game)


def measure(options: Options) -> Report:
    keys = [KEYS_OF_ACTION[action] for action in MINIMAL_ACTIONS[options.game]]
    rows = []
    # All are made at once: an unknown or damaged one is told before the minutes of the others.
    plays = [_play(name, options.model_rate) for name in options.robots]
    for play in plays:
        check_one_copy(play)
    robots = [ROBOTS.make(each.robot, SCREEN_SHAPE, CameraConfig(), each) for each in plays]
    told = [random_commands(keys, every, options.steps, options.seed) for every in options.every]
    equal = (options.latency, options.gap)
    plan = CommandPlan.of_play(PlayConfig(hands_model=options.hands_model))
    schedules = [keys_held(_exact_hands(), each, *equal) for each in told]
    for name, robot in zip(options.robots, robots, strict=True):
        for every, given, schedule in zip(options.every, told, schedules, strict=True):
            other = keys_held(robot, given, *equal, plan) != schedule
            rows.append(
                {
                    "robot": name,
                    "agent steps between commands": every,
                    "share of frames with other keys": float(other.mean()),
                }
            )
        robot.close()
    gap = f", {options.gap} frames between two keys" if options.gap else ""
    return Report.of(
        f"Keys of equal hands, {options.latency} frames late{gap}",
        rows,
        {name: getattr(options, name) for name in _TOLD},
    )


def _play(robot: str, model_rate: int) -> PlayConfig:
    play = PlayConfig(robot=robot)
    return replace(play, robot_settings=f"rate={model_rate}") if play.latency_model else play


def _exact_hands() -> Hands:
    """Returns hands that press and release as soon as they are told to."""
    return hands_of(PlayConfig(hand="model"), None, np.random.default_rng(0))


def random_commands(keys: Sequence[Keys], every: int, steps: int, seed: int) -> list[Keys]:
    """Returns the command of each agent step; on average one in ``every`` steps is drawn anew."""
    rng = np.random.default_rng(seed)
    return [keys[0], *commands(keys, steps - 1, rng, means=(every,))]


def keys_held(
    hands: Hands,
    told: Sequence[Keys],
    latency: int,
    gap: int = 0,
    plan: CommandPlan | None = None,
) -> NDArray[np.int64]:
    """Returns the keys at the end of each emulator frame, with ``hands`` made equal,
    ``int [commands told × frame skip]``."""
    equal = LatencyEqualiser(hands, latency, gap, plan=plan)
    equal.time(~Keys.NONE)
    equal.rest()
    held: list[Keys] = []
    for keys in told:
        held += hold(equal, keys, PlayConfig.frame_skip)
    return np.array(held, np.int64)


if __name__ == "__main__":
    main("lab.equal_hands", Options, measure)
