"""`python -m benchmarks.learner_updates`: how long an update takes, by threads and precision.

The settings take turns, a few updates each, so that a slow moment of the machine falls on all of
them alike.
"""

import itertools
import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import tyro

from benchmarks.report import publish
from common.network import build_network
from common.presets import PRESETS
from learner.device import Device
from learner.trainer import DeviceBatch, Trainer


@dataclass(frozen=True)
class Options:
    """Time updates of the fast preset's Double DQN on random minibatches, on the CPU."""

    batch_size: int = 32
    """Transitions per update."""
    rounds: int = 40
    """Turns of each setting."""
    turn: int = 5
    """Updates per turn."""
    json: Path | None = None
    """File for the results."""


def _random_batch(size: int) -> DeviceBatch:
    def frames() -> torch.Tensor:
        return torch.randint(256, (size, 4, 84, 84), dtype=torch.uint8)

    return DeviceBatch(
        s_tm1=frames(),
        a_tm1=torch.randint(6, (size,)),
        r_t=torch.randn(size),
        discount_t=torch.full((size,), 0.97),
        s_t=frames(),
        weights=torch.ones(size),
        x_tm1=torch.zeros(size, 0),
        x_t=torch.zeros(size, 0),
    )


def main() -> None:
    options = tyro.cli(Options, prog="python -m benchmarks.learner_updates")
    config = PRESETS["fast"]
    batch = _random_batch(options.batch_size)
    cores = len(os.sched_getaffinity(0))
    settings = list(itertools.product(sorted({1, cores}), (False, True)))
    trainers = {
        bfloat16: Trainer(
            build_network(config, 6), config.learning, Device(torch.device("cpu"), bfloat16)
        )
        for bfloat16 in (False, True)
    }
    seconds: dict[tuple[int, bool], list[float]] = {setting: [] for setting in settings}
    for turn in range(options.rounds + 1):
        for threads, bfloat16 in settings:
            torch.set_num_threads(threads)
            for _ in range(options.turn):
                began = time.perf_counter()
                trainers[bfloat16].update(batch)
                if turn:  # the first turn warms up
                    seconds[threads, bfloat16].append(time.perf_counter() - began)
    plain = float(np.median(seconds[1, False]))
    publish(
        f"Double DQN update, batch {options.batch_size}, 84×84×4, "
        f"{options.rounds * options.turn} updates each",
        [
            {
                "threads": threads,
                "precision": "bfloat16" if bfloat16 else "float32",
                "p50 ms": float(np.median(times)) * 1e3,
                "p95 ms": float(np.percentile(times, 95)) * 1e3,
                "times float32 on one thread": plain / float(np.median(times)),
            }
            for (threads, bfloat16), times in seconds.items()
        ],
        options.json,
    )


if __name__ == "__main__":
    main()
