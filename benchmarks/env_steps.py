"""`python -m benchmarks.env_steps`: decisions per second of environments on one core.

No policy, no stream: random actions. The kinds of environment take turns, so that a slow moment
of the machine falls on all of them. Where a decision's time goes is measured in turns of their
own, so that the stopwatches are not in the rates.
"""

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal
from unittest.mock import patch

import cv2
import gymnasium
import numpy as np
import tyro

from actors.envs import make_env
from actors.envs.emulator import Emulator
from actors.robots.nao.room import Room
from actors.robots.nao.sensor import Sensor
from actors.vision.screen_detector import ScreenDetector
from benchmarks.neighbour import neighbour
from benchmarks.report import publish
from common.errors import InputError, exit_on_input_error
from common.run.config import CameraConfig
from common.run.presets import PRESETS

Kind = Literal["robot_sync", "robot_wait", "ale"]

_TITLES: dict[Kind, str] = {
    "robot_sync": "robot",
    "robot_wait": "robot, waiting",
    "ale": "ALE-Only",
}

_PARTS: dict[str, tuple[tuple[type, str], ...]] = {
    "physics": ((Room, "step_frame"), (Room, "command")),
    "emulator": ((Emulator, "act"), (Emulator, "screen_rgb")),
    "render": ((Room, "picture"), (Sensor, "take")),
    "detection": ((ScreenDetector, "detect"),),
}
"""What a decision is made of: methods, none of which calls another of them. Physics includes the
hands' control and reading the keys; detection includes unwarping to 84×84."""


@dataclass(frozen=True)
class Options:
    """Time the environments' decisions: the emulator alone, and the robot."""

    game: str = "pong"
    """Any game that ale-py bundles."""
    envs: int = 1
    """Environments of each kind, which take turns in this one process."""
    decisions: int = 500
    """Steps per turn, over all environments of a kind."""
    turns: int = 8
    """Turns of each kind."""
    camera: CameraConfig = field(default_factory=CameraConfig)
    """The robot's camera; perfect by default."""
    beside_learner: bool = False
    """Let another process train a network on another core meanwhile."""
    json: Path | None = None
    """File for the results."""


@dataclass
class Pace:
    """What was counted of one kind of environment."""

    rates: list[float] = field(default_factory=list)
    """Decisions per second, turn by turn."""
    steps: int = 0
    decisions: int = 0

    @property
    def per_second(self) -> float:
        """Decisions per second: the median turn's."""
        return float(np.median(self.rates))


class Player:
    """Environments of one kind, played at random in turn."""

    def __init__(self, kind: Kind, options: Options) -> None:
        preset = PRESETS["robot"]
        config = replace(
            preset,
            play=replace(preset.play, minimal_actions=False),
            env="ale" if kind == "ale" else "robot",
            game=options.game,
            camera=options.camera,
        )
        config.check()
        self._envs: list[gymnasium.Env[Any, Any]] = [
            make_env(config, training=True, wait_action=kind == "robot_wait")
            for _ in range(options.envs)
        ]
        for number, env in enumerate(self._envs):
            env.reset(seed=number)
        self._rng = np.random.default_rng(1)

    def play(self, steps: int, pace: Pace) -> float:
        """Play so many steps; the seconds that each decision took."""
        actions = self._rng.integers(18, size=steps)
        decisions = 0
        began = time.perf_counter()
        for number, action in enumerate(actions):
            env = self._envs[number % len(self._envs)]
            _, _, terminated, truncated, info = env.step(action)
            decisions += info["elapsed"]
            if terminated or truncated:
                env.reset()
        each = (time.perf_counter() - began) / decisions
        pace.rates.append(1 / each)
        pace.steps += steps
        pace.decisions += decisions
        return each

    def close(self) -> None:
        """Close all environments."""
        for env in self._envs:
            env.close()


@contextmanager
def stopwatches() -> Iterator[dict[str, float]]:
    """Time the parts of all robots' decisions while it is entered: seconds so far, by part."""
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
        yield spent


def break_down(player: Player, steps: int) -> dict[str, float]:
    """µs that each part of a decision takes, and the rest; what resets take is in it too."""
    pace = Pace()
    with stopwatches() as spent:
        each = player.play(steps, pace)
    parts = {part: seconds / pace.decisions * 1e6 for part, seconds in spent.items()}
    return {**parts, "rest": each * 1e6 - sum(parts.values())}


def measure(options: Options) -> tuple[dict[Kind, Pace], dict[str, float]]:
    """Paces by kind, and the medians of where the time of a robot's decision goes, µs."""
    players = {kind: Player(kind, options) for kind in _TITLES}
    paces: dict[Kind, Pace] = {}
    breakdowns: list[dict[str, float]] = []
    for turn in range(options.turns + 1):
        if turn <= 1:  # the first turn warms up
            paces = {kind: Pace() for kind in players}
            breakdowns.clear()
        for kind, player in players.items():
            player.play(options.decisions, paces[kind])
        breakdowns.append(break_down(players["robot_sync"], options.decisions))
    for player in players.values():
        player.close()
    return paces, {
        part: float(np.median([found[part] for found in breakdowns])) for part in breakdowns[0]
    }


def main() -> None:
    options = tyro.cli(Options, prog="python -m benchmarks.env_steps")
    if min(options.envs, options.decisions, options.turns) < 1:
        raise InputError("choose 1 or more environments, decisions and turns.")
    cv2.setNumThreads(1)
    with neighbour() if options.beside_learner else nullcontext():
        paces, breakdown = measure(options)
    alone = paces["ale"].per_second
    count = f"{options.envs} environments" if options.envs > 1 else "one environment"
    publish(
        f"{options.game}: decisions of 66.7 ms, {count} in one process, one core"
        f"{', beside an updating learner' if options.beside_learner else ''}",
        [
            {
                "kind": _TITLES[kind],
                "decisions": pace.decisions,
                "per step": pace.decisions / pace.steps,
                "per second": pace.per_second,
                "least": min(pace.rates),
                "most": max(pace.rates),
                "of ALE-Only": pace.per_second / alone,
            }
            for kind, pace in paces.items()
        ],
        options.json,
        {
            **{kind: pace.per_second for kind, pace in paces.items()},
            "envs": options.envs,
            "breakdown_us": breakdown,
        },
    )
    print(
        "A robot's decision: "
        + ", ".join(f"{part} {micros:.0f} µs" for part, micros in breakdown.items())
    )


if __name__ == "__main__":
    exit_on_input_error(main)
