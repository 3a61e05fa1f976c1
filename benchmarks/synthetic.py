"""`noise_chunks`: endless chunks as from several actors, made ahead of time."""

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from common.protocol.chunk import Chunk
from common.protocol.step_fields import FRAME_SHAPE, zero_steps
from common.settings.config import RunConfig

_GAME_STEPS = 500
_POOL = 16


def noise_chunks(run: str, actors: tuple[str, ...], config: RunConfig) -> Iterator[Chunk]:
    """Returns chunks in the order in which ``actors`` that play equally fast would send them.

    Their frames come from a small pool, because the measured code copies pixels without looking at
    them. A step field that affects no measurement is 0.

    Args:
        run: the run's id.
        config: gives the length of the chunks, and how much context they have.
    """
    steps, older = config.stream.chunk_steps, config.play.frame_stack - 1
    rng = np.random.default_rng(1)
    blank = zero_steps(steps)
    pool = [
        Chunk(
            run_id=run,
            actor=actors[0],
            incarnation=1,
            stream=0,
            sequence=0,
            weights_version=0,
            epsilon=0.1,
            context=frames[:older],
            final_frames=np.zeros((0, *FRAME_SHAPE), np.uint8),
            final_vectors=np.zeros((0, 0), np.float32),
            **blank
            | {name: np.ones_like(blank[name]) for name in ("elapsed", "valid", "matched")}
            | {
                "frames": frames[older:],
                "actions": rng.integers(6, size=steps, dtype=np.uint8),
                "rewards": rng.integers(-1, 2, size=steps).astype(np.float32),
                "terminated": rng.random(steps) < 1 / _GAME_STEPS,
            },
        )
        for frames in rng.integers(256, size=(_POOL, older + steps, *FRAME_SHAPE), dtype=np.uint8)
    ]
    turns = ((sequence, actor) for sequence in itertools.count() for actor in actors)
    return (
        replace(pooled, actor=actor, sequence=sequence)
        for pooled, (sequence, actor) in zip(itertools.cycle(pool), turns, strict=False)
    )
