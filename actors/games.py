"""Whole games by given weights, each told as a line of JSON: one process of an evaluation.

`python -m actors.games` is started by `python -m learner --evaluate`; nothing of it is stored or
learned from.
"""

import json
import threading
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Self

import cv2
import numpy as np
import torch
import tyro

from actors.counters import ActorCounters
from actors.envs import make_env
from actors.loop import play
from actors.policy import Policy
from common.errors import exit_on_input_error
from common.process.lifeline import leave_with_parent, on_signals
from common.run.clock import ClockConfig
from common.run.config import RunConfig, from_mapping


@dataclass(frozen=True)
class GamesOptions:
    """Play whole games and print a line of JSON for each."""

    weights: Path
    """Network that plays."""
    config: str
    """Configuration of the run to play under, as JSON."""
    games: int = 1
    steps: int = 0
    """Minimum number of agent steps, over all games, as in the tests of 2017."""
    epsilon: float = 0.001
    """Share of random agent steps."""
    seed: int = 1
    clock: tyro.conf.OmitArgPrefixes[ClockConfig] = field(default_factory=ClockConfig)
    leash: bool = False


@dataclass(frozen=True)
class GameResult:
    """One game from its start to its end."""

    score: float
    steps: int
    matched: int
    """Steps at whose end the commanded keys were pressed."""
    valid: int
    """Steps in which the screen was found."""
    decisions: int
    """Agent steps of game time that the steps took."""
    missed_deadlines: int
    late_frames: int
    """As `ActorCounters` has them; 0 unless in real time."""
    key_times: tuple[int, ...]
    """How long the hands took, as counts (see `common.press_latency`)."""

    @classmethod
    def of(cls, score: float, counters: ActorCounters) -> Self:
        """Returns the game that ``counters`` counted."""
        stats = counters.stats
        return cls(
            score=score,
            steps=stats.steps,
            matched=stats.matched,
            valid=stats.valid,
            decisions=stats.decisions,
            missed_deadlines=stats.missed_deadlines,
            late_frames=stats.late_frames,
            key_times=tuple(counters.key_times),
        )


def games(config: RunConfig, options: GamesOptions, stop: threading.Event) -> Iterator[GameResult]:
    """Games to their ends, until there are enough of them and of their steps, or ``stop``."""
    env = make_env(config, options.clock, training=False)
    try:
        policy_seed, env_seed = map(int, np.random.SeedSequence(options.seed).generate_state(2))
        actions = int(env.action_space.n)  # type: ignore[attr-defined]
        policy = Policy.of_file(config, actions, options.weights, options.epsilon, policy_seed)
        ended, counters = 0, ActorCounters()
        for steps, step in enumerate(play([env], policy, [env_seed]), start=1):
            counters.count(step)
            if step.info.game_over:
                yield GameResult.of(step.info.game_score, counters)
                ended, counters = ended + 1, ActorCounters()
                if ended >= options.games and steps >= options.steps:
                    return
            if stop.is_set():
                return
    finally:
        env.close()


def main() -> int:
    options = tyro.cli(GamesOptions, prog="python -m actors.games")
    stop = threading.Event()
    on_signals(stop)
    if options.leash:
        leave_with_parent(stop)
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    config = from_mapping(RunConfig, json.loads(options.config))
    for result in games(config, options, stop):
        print(json.dumps(asdict(result)), flush=True)
    return 0


if __name__ == "__main__":
    exit_on_input_error(main)
