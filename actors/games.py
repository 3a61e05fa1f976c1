"""One process of an evaluation: it plays whole games and prints a line of JSON for each.

`python -m learner.evaluation` starts it as `python -m actors.games`. Nothing is stored, and nothing
is learned from its games.
"""

if __name__ == "__main__":
    from common.process.lifeline import leave_on_leash

    leave_on_leash()

import json
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import cv2
import torch
import tyro

from actors.counters import ActorCounters
from actors.envs import make_env
from actors.game_recorder import GameRecorder
from actors.loop import play, seeds_of
from actors.policy import Policy
from common.command_line.parser import parse
from common.errors import InputError
from common.exit_codes import FAILED
from common.process.lifeline import on_signals
from common.process.program_end import exit_on_input_error
from common.settings.clock import ClockConfig
from common.settings.config import RunConfig
from common.settings.stored_config import from_mapping


@dataclass(frozen=True)
class GamesOptions:
    """Play whole games and print a line of JSON for each."""

    weights: Path
    """Network that plays."""
    settings: str
    """Configuration of the run to play under, as JSON."""
    ending: int
    """Number of last agent steps of a game that are hashed by themselves."""
    epsilon: float
    """Share of random agent steps."""
    games: int = 1
    steps: int = 0
    """Minimum number of steps over all games, as in the tests of 2017."""
    seed: int = 1
    clock: tyro.conf.OmitArgPrefixes[ClockConfig] = field(default_factory=ClockConfig)


_COUNTED = ("steps", "matched", "valid", "decisions", "missed_deadlines", "late_frames")
"""Counters of `ActorStats` that are reported for each game."""


def games(
    config: RunConfig, options: GamesOptions, stop: threading.Event
) -> Iterator[dict[str, Any]]:
    """Yields the result of each whole game, until there are enough games and steps. Raises
    InputError if ``stop`` is set before."""
    with closing(make_env(config, options.clock, training=False)) as inner:
        env = GameRecorder(inner, options.ending)
        policy_seed, env_seed = seeds_of(options.seed)
        policy = Policy.of_file(config, options.weights, options.epsilon, policy_seed)
        ended, counters = 0, ActorCounters()
        for steps, step in enumerate(play([env], policy, [env_seed]), start=1):
            counters.count(step)
            if step.info.game_over:
                counted = asdict(counters.stats)
                yield {
                    "score": step.info.game_score,
                    **{name: counted[name] for name in _COUNTED},
                    "follows": counters.follows,
                    "key_times": counters.key_times,
                    "game_seconds": counted["decisions"] / inner.rate,
                    "wall_seconds": env.seconds,
                    "game_hash": env.game_hash,
                    "ending_hash": env.ending_hash,
                }
                ended, counters = ended + 1, ActorCounters()
                if ended >= options.games and steps >= options.steps:
                    return
            if stop.is_set():  # the mean of fewer games than were asked for would be told
                raise InputError(
                    "a playing process was asked to end, so games are missing: evaluate again.",
                    FAILED,
                )


def main() -> int:
    options = parse(GamesOptions, "actors.games", sys.argv[1:])
    stop = threading.Event()
    on_signals(stop)
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    config = from_mapping(RunConfig, json.loads(options.settings))
    with os.fdopen(os.dup(1), "w") as told:
        os.dup2(2, 1)  # what an environment of another package prints is no game
        for result in games(config, options, stop):
            print(json.dumps(result), file=told, flush=True)
    return 0


if __name__ == "__main__":
    exit_on_input_error(main)
