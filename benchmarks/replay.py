"""`python -m benchmarks.replay`: the replay in one process, at several sizes.

For each size there are four measurements:

1. An empty ring is filled with chunks of camera frames.
2. Chunks are inserted into the full ring, each evicting another.
3. Batches are drawn from it uniformly.
4. It is opened again as a prioritised one, as by a resumed run; batches are drawn and given new
   priorities.

Nothing else happens meanwhile. A real replay also decodes messages, see `benchmarks.transport`.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.child import scratch
from benchmarks.pace import per_second
from benchmarks.report import BenchmarkOptions, Numbers, Report, Seconds, main
from benchmarks.synthetic import camera_chunks
from common.checked import FromOne
from common.errors import InputError, writing
from common.process.footprint import footprint
from common.protocol.chunk import Chunk
from common.settings.config import ReplayConfig, RunConfig, StreamConfig
from common.settings.presets import PRESETS
from replay.batch import Batch
from replay.replay_buffer import ReplayBuffer

BATCH = 32
_NO_BOUND = 10**9


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Time inserts and draws of the replay, and measure its memory."""

    sizes: Numbers = (10_000, 100_000, 1_000_000)
    """Capacities of the replay, in steps; it is full when it is measured."""
    seconds: Seconds = 5.0
    """Length of each measurement, in seconds."""
    chunk_steps: FromOne = 64
    """Agent steps per chunk."""
    actors: FromOne = 8
    """Number of actors whose chunks take turns."""
    folder: Path | None = None
    """Folder for the files, 7.1 KB per step; a temporary one by default."""

    def check(self) -> None:
        super().check()
        if min(self.sizes) < 4 * self.chunk_steps:
            raise InputError(f"--sizes: choose sizes of {4 * self.chunk_steps} or more.")
        if self.folder is not None:
            with writing(self.folder):
                self.folder.mkdir(parents=True, exist_ok=True)


def unlimited(capacity: int) -> RunConfig:
    """Returns the 2017 settings, with a limiter that never waits."""
    config = PRESETS["paper"]
    return replace(
        config, replay=ReplayConfig(capacity=capacity, learning_starts=1, ratio_tolerance=_NO_BOUND)
    )


def prioritised(config: RunConfig) -> RunConfig:
    """Returns ``config`` with proportional priorities."""
    return replace(config, replay=replace(config.replay, sampler="prioritised"))


def fill(buffer: ReplayBuffer, chunks: Iterator[Chunk], capacity: int) -> int:
    """Inserts until the ring is full once; returns the number of steps that it took."""
    steps = 0
    while steps < capacity:
        chunk = next(chunks)
        buffer.insert(chunk)
        steps += len(chunk)
    return steps


def draw(buffer: ReplayBuffer) -> Batch:
    batch = buffer.sample(0, 0.0)
    if batch is None:
        raise RuntimeError("no batch was to be had")
    return batch


def draw_and_rate(buffer: ReplayBuffer, rng: np.random.Generator) -> Callable[[], None]:

    def action() -> None:
        batch = draw(buffer)
        buffer.update_priorities(batch.ids, rng.random(len(batch.ids)).astype(np.float32))

    return action


def measure_size(capacity: int, options: Options, folder: Path) -> dict[str, Any]:
    config = replace(unlimited(capacity), stream=StreamConfig(chunk_steps=options.chunk_steps))
    names = tuple(f"actor-{number}" for number in range(1, options.actors + 1))
    chunks = camera_chunks("bench", names, config)
    before = footprint().private
    buffer = ReplayBuffer(config, folder)
    began = time.perf_counter()
    filled = fill(buffer, chunks, capacity)
    fill_seconds = time.perf_counter() - began
    inserts = per_second(lambda: buffer.insert(next(chunks)), options.seconds)
    uniform = per_second(lambda: draw(buffer), options.seconds)
    told = buffer.progress(_NO_BOUND)
    buffer.close()
    began = time.perf_counter()
    buffer = ReplayBuffer(prioritised(config), folder)
    reopen_seconds = time.perf_counter() - began
    inserts_prioritised = per_second(lambda: buffer.insert(next(chunks)), options.seconds)
    rated = per_second(draw_and_rate(buffer, np.random.default_rng(1)), options.seconds)
    told_prioritised = buffer.progress(_NO_BOUND)
    buffer.close()
    return {
        "capacity": capacity,
        "stored": told.stored,
        "fill_steps_per_second": filled / fill_seconds,
        "insert_steps_per_second": inserts * options.chunk_steps,
        "insert_steps_per_second_prioritised": inserts_prioritised * options.chunk_steps,
        "uniform_batches_per_second": uniform,
        "prioritised_batches_per_second": rated,
        "reopen_seconds": reopen_seconds,
        "private_bytes": told.private_bytes,
        "private_bytes_prioritised": told_prioritised.private_bytes,
        "private_bytes_before": before,
        "file_bytes": told.file_bytes,
    }


def row(found: dict[str, Any]) -> dict[str, Any]:
    return {
        "steps": found["stored"],
        "fill": round(found["fill_steps_per_second"]),
        "insert": round(found["insert_steps_per_second"]),
        "uniform": round(found["uniform_batches_per_second"]),
        "insert, prioritised": round(found["insert_steps_per_second_prioritised"]),
        "prioritised": round(found["prioritised_batches_per_second"]),
        "private MB": found["private_bytes_prioritised"] / 1e6,
        "file GB": found["file_bytes"] / 1e9,
    }


def measure(options: Options) -> Report:
    sizes = []
    for capacity in options.sizes:
        with scratch(options.folder) as folder:
            sizes.append(measure_size(capacity, options, folder / "replay"))
    return Report.of(
        f"Replay, per second: steps inserted in chunks of {options.chunk_steps} (first into fresh "
        f"files), batches of {BATCH} (prioritised: with priority updates)",
        [row(each) for each in sizes],
        {"batch_size": BATCH, "chunk_steps": options.chunk_steps, "sizes": sizes},
    )


if __name__ == "__main__":
    main("replay", Options, measure)
