"""`python -m benchmarks.env_steps`: agent steps per second of environments on one core.

Actions are random, without policy and stream. The kinds of environment take turns. How an agent
step spends its time is measured in separate turns, so that stopwatches do not lower the rates.
"""

import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal, NamedTuple
from unittest.mock import patch

import cv2
import gymnasium
import numpy as np

from actors.envs import make_env
from actors.envs.emulator import Emulator
from actors.robots.nao.robot import Nao
from actors.robots.room.sensor import Sensor
from actors.vision.screen_detector import ScreenDetector
from benchmarks.neighbour import neighbour
from benchmarks.pace import Spread, in_turns
from benchmarks.report import BenchmarkOptions, Report, main
from common.checked import FromOne
from common.run.rules import check_config
from common.settings.clock import ClockConfig
from common.settings.conditions import CameraConfig
from common.settings.presets import PRESETS

Kind = Literal["robot_sync", "robot_wait", "ale"]

_TITLES: dict[Kind, str] = {
    "robot_sync": "robot",
    "robot_wait": "robot, waiting",
    "ale": "ALE-Only",
}

_PARTS: dict[str, tuple[tuple[type, str], ...]] = {
    "physics": ((Nao, "step_frame"), (Nao, "command")),
    "emulator": ((Emulator, "act"), (Emulator, "screen_rgb")),
    "render": ((Nao, "picture"), (Sensor, "take")),
    "detection": ((ScreenDetector, "detect"),),
}
"""Parts of an agent step: methods that do not call each other. Physics includes the hands' control
and reading the keys; detection includes unwarping to 84×84."""


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Time the agent steps of the environments: the emulator alone, and the robot."""

    game: str = "pong"
    """Any game that ale-py bundles."""
    envs: FromOne = 1
    """Number of environments of each kind, which take turns in this one process."""
    steps: FromOne = 500
    """Agent steps per turn, over all environments of a kind."""
    turns: FromOne = 8
    """Number of turns of each kind."""
    camera: CameraConfig = field(default_factory=CameraConfig)
    """The robot's camera; perfect by default."""
    beside_learner: bool = False
    """Train a network in another process on another core meanwhile."""


class Turn(NamedTuple):
    """The counts of one turn of one kind of environment."""

    steps: int
    agent_steps: int
    seconds: float


class Player:
    """Plays environments of one kind at random, in turn."""

    def __init__(self, kind: Kind, options: Options) -> None:
        preset = PRESETS["robot"]
        config = replace(
            preset,
            play=replace(preset.play, minimal_actions=False),
            env="ale" if kind == "ale" else "robot",
            game=options.game,
            camera=options.camera,
        )
        check_config(config)
        self._envs: list[gymnasium.Env[Any, Any]] = [
            make_env(config, ClockConfig(wait_action=kind == "robot_wait"), training=True)
            for _ in range(options.envs)
        ]
        for number, env in enumerate(self._envs):
            env.reset(seed=number)
        self._rng = np.random.default_rng(1)

    def play(self, steps: int) -> Turn:
        actions = self._rng.integers(18, size=steps)
        agent_steps = 0
        began = time.perf_counter()
        for number, action in enumerate(actions):
            env = self._envs[number % len(self._envs)]
            _, _, terminated, truncated, info = env.step(action)
            agent_steps += info["elapsed"]
            if terminated or truncated:
                env.reset()
        return Turn(steps, agent_steps, time.perf_counter() - began)

    def close(self) -> None:
        for env in self._envs:
            env.close()


def break_down(player: Player, steps: int) -> dict[str, float]:
    """Plays with stopwatches; returns the µs of each part of an agent step, including resets."""
    spent = dict.fromkeys(_PARTS, 0.0)

    def timed(part: str, method: Any) -> Any:
        def run(*args: Any, **kwargs: Any) -> Any:
            began = time.perf_counter()
            result = method(*args, **kwargs)
            spent[part] += time.perf_counter() - began
            return result

        return run

    with ExitStack() as stack:
        for part, methods in _PARTS.items():
            for owner, name in methods:
                watched = timed(part, getattr(owner, name))
                stack.enter_context(patch.object(owner, name, watched))
        turn = player.play(steps)
    rest = turn.seconds - sum(spent.values())
    return {part: took / turn.agent_steps * 1e6 for part, took in {**spent, "rest": rest}.items()}


def measure(options: Options) -> Report:
    cv2.setNumThreads(1)
    with ExitStack() as stack:
        if options.beside_learner:
            stack.enter_context(neighbour())
        players = {kind: stack.enter_context(closing(Player(kind, options))) for kind in _TITLES}
        contenders: dict[str, Callable[[], Any]] = {
            kind: partial(player.play, options.steps) for kind, player in players.items()
        }
        contenders["parts"] = partial(break_down, players["robot_sync"], options.steps)
        played = in_turns(contenders, options.turns)
    parted = played.pop("parts")
    breakdown = {part: float(np.median([each[part] for each in parted])) for part in parted[0]}
    paces = {
        kind: Spread.of([turn.agent_steps / turn.seconds for turn in turns])
        for kind, turns in played.items()
    }
    totals = {kind: np.sum(turns, axis=0).tolist() for kind, turns in played.items()}
    rows = [
        {
            "kind": title,
            "agent steps": int(totals[kind][1]),
            "per step": totals[kind][1] / totals[kind][0],
            **paces[kind].cells(),
            "of ALE-Only": paces[kind].median / paces["ale"].median,
        }
        for kind, title in _TITLES.items()
    ]
    count = f"{options.envs} environments" if options.envs > 1 else "one environment"
    return Report.of(
        f"{options.game}: agent steps of 66.7 ms, {count} in one process, one core"
        f"{', beside an updating learner' if options.beside_learner else ''}",
        rows,
        {
            **{kind: pace.median for kind, pace in paces.items()},
            "envs": options.envs,
            "breakdown_us": breakdown,
        },
        "An agent step of the robot: "
        + ", ".join(f"{part} {micros:.0f} µs" for part, micros in breakdown.items()),
    )


if __name__ == "__main__":
    main("env_steps", Options, measure)
