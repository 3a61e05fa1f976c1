"""`camera_chunks`: endless chunks as from several actors, made ahead of time."""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.envs import make_env
from actors.envs.observation import frames_and_vector
from common.protocol.chunk import Chunk
from common.protocol.step_fields import FRAME_SHAPE, zero_steps
from common.settings.config import RunConfig
from common.settings.presets import PRESETS

_GAME_STEPS = 500
_POOL = 8


def camera_chunks(run: str, actors: tuple[str, ...], config: RunConfig) -> Iterator[Chunk]:
    """Returns chunks in the order in which ``actors`` that play equally fast would send them.

    Their frames are what a robot's camera saw of Pong under random actions, since how well they
    compress decides how much travels. They come from a small pool. A step field that affects no
    measurement is 0.

    Args:
        run: the run's id.
        config: gives the length of the chunks, and how much context they have.
    """
    steps, older = config.stream.chunk_steps, config.play.frame_stack - 1
    rng = np.random.default_rng(1)
    blank: dict[str, Any] = zero_steps(steps)
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
        for frames in _camera_frames(_POOL * (older + steps)).reshape(_POOL, -1, *FRAME_SHAPE)
    ]
    turns = ((sequence, actor) for sequence in itertools.count() for actor in actors)
    return (
        replace(pooled, actor=actor, sequence=sequence)
        for pooled, (sequence, actor) in zip(itertools.cycle(pool), turns, strict=False)
    )


def _camera_frames(count: int) -> NDArray[np.uint8]:
    """Returns successive frames of random play, ``[count, 84, 84]``."""
    env = make_env(PRESETS["robot"], training=False)
    rng = np.random.default_rng(1)
    state, _ = env.reset(seed=1)
    frames: list[NDArray[np.uint8]] = []
    while len(frames) < count:
        frames.append(frames_and_vector(state)[0][-1])
        state, _, terminated, truncated, _ = env.step(rng.integers(6))
        if terminated or truncated:
            state, _ = env.reset()
    env.close()
    return np.stack(frames)
