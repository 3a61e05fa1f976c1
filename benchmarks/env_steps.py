"""`python -m benchmarks.env_steps`: decisions per second of one environment on one core.

No policy, no stream: random actions. The environments take turns, so that a slow moment of the
machine falls on both.
"""

import time
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import tyro

from actors.envs import make_env
from benchmarks.report import publish
from common.config import EnvKind
from common.errors import exit_on_input_error
from common.presets import PRESETS


@dataclass(frozen=True)
class Options:
    """Time the environments' decisions: the emulator alone, and the robot."""

    game: str = "pong"
    """Any game that ale-py bundles."""
    decisions: int = 500
    """Decisions per turn."""
    turns: int = 8
    """Turns of each environment."""
    json: Path | None = None
    """File for the results."""


def main() -> None:
    options = tyro.cli(Options, prog="python -m benchmarks.env_steps")
    cv2.setNumThreads(1)
    kinds: tuple[EnvKind, ...] = ("ale", "robot")
    rng = np.random.default_rng(1)
    envs = {
        kind: make_env(replace(PRESETS["robot"], env=kind, game=options.game), training=True)
        for kind in kinds
    }
    rates: dict[EnvKind, list[float]] = {kind: [] for kind in kinds}
    for env in envs.values():
        env.reset(seed=1)
    for turn in range(options.turns + 1):
        for kind, env in envs.items():
            actions = rng.integers(18, size=options.decisions)
            began = time.perf_counter()
            for action in actions:
                _, _, terminated, truncated, _ = env.step(action)
                if terminated or truncated:
                    env.reset()
            if turn:  # the first turn warms up
                rates[kind].append(options.decisions / (time.perf_counter() - began))
    publish(
        f"{options.game}: decisions of 4 emulator frames, one environment, one core, sync",
        [
            {
                "environment": {"ale": "ALE-Only", "robot": "ALE-Robot, 320×240"}[kind],
                "decisions": options.decisions * options.turns,
                "p50 per second": float(np.median(found)),
                "least": min(found),
                "most": max(found),
            }
            for kind, found in rates.items()
        ],
        options.json,
    )


if __name__ == "__main__":
    exit_on_input_error(main)
