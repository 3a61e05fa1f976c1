"""Replays of other libraries and ours behind one interface, for `benchmarks.peers`.

All are created full: ours of camera frames, the others of noise; none of them looks at pixels. The
others take single steps with whole states, as their users insert them; ours takes chunks. Each is
measured in a process of its own, because the cost of a batch depends, up to tenfold, on what the
process has allocated before.
"""

import itertools
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.child import serve
from benchmarks.pace import slice_per_second
from benchmarks.replay import BATCH, draw, draw_and_rate, fill, prioritised, unlimited
from benchmarks.synthetic import camera_chunks
from replay.replay_buffer import ReplayBuffer

_POOL = 64
_ALPHA, _BETA = 0.6, 0.4


class Wanted(NamedTuple):
    """The properties that a replay should have."""

    size: int
    """Capacity in steps."""
    folder: Path
    prioritised: bool


class Filled(NamedTuple):
    """A full replay."""

    insert: Callable[[], object]
    """Inserts steps in the place of old ones."""
    draw: Callable[[], object]
    """Draws a batch, and gives it new priorities if the replay has priorities."""
    steps: int = 1
    """Steps per insert."""


def ours(wanted: Wanted) -> Filled:
    """Returns this project's `ReplayBuffer`, in files."""
    config = unlimited(wanted.size)
    buffer = ReplayBuffer(prioritised(config) if wanted.prioritised else config, wanted.folder)
    chunks = camera_chunks("bench", ("actor-1",), config)
    fill(buffer, chunks, wanted.size)
    rated = draw_and_rate(buffer, np.random.default_rng(1))
    return Filled(
        lambda: buffer.insert(next(chunks)),
        rated if wanted.prioritised else lambda: draw(buffer),
        config.stream.chunk_steps,
    )


def _states(*shape: int) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
    """Yields endless pairs of a state of noise and the next one."""
    pool = np.random.default_rng(1).integers(256, size=(_POOL, *shape), dtype=np.uint8)
    return itertools.pairwise(itertools.cycle(pool))


def cpprb(wanted: Wanted, **shared: Any) -> Filled:
    """Returns cpprb's replay.

    Args:
        shared: what is stored only once. Without it a step takes 56 KB; with each stack's frames
            stored once, 14 KB; with the frames of a state and the next stored once, 7 KB.
    """
    import cpprb

    layout: dict[str, Any] = {
        "obs": {"shape": (84, 84, 4), "dtype": np.uint8},
        "act": {"dtype": np.uint8},
        "rew": {"dtype": np.float32},
        "done": {"dtype": np.float32},
    }
    if "next_of" not in shared:
        layout["next_obs"] = layout["obs"]
    states, rng = _states(84, 84, 4), np.random.default_rng(1)

    def insert() -> None:
        state, following = next(states)
        replay.add(obs=state, next_obs=following, act=1, rew=0.0, done=0.0)

    def rated() -> None:
        drawn = replay.sample(BATCH, beta=_BETA)
        replay.update_priorities(drawn["indexes"], rng.random(BATCH))

    if wanted.prioritised:
        replay = cpprb.PrioritizedReplayBuffer(wanted.size, layout, alpha=_ALPHA, **shared)
    else:
        replay = cpprb.ReplayBuffer(wanted.size, layout, **shared)
    for _ in range(wanted.size):
        insert()
    return Filled(insert, rated if wanted.prioritised else lambda: replay.sample(BATCH))


def stable_baselines3(wanted: Wanted) -> Filled:
    """Returns stable-baselines3's replay, as its DQN makes it; it has no priorities."""
    from gymnasium.spaces import Box, Discrete
    from stable_baselines3.common.buffers import ReplayBuffer

    replay: Any = ReplayBuffer(
        wanted.size, Box(0, 255, (4, 84, 84), np.uint8), Discrete(6), torch.device("cpu")
    )
    states, zero = _states(1, 4, 84, 84), np.zeros(1)

    def insert() -> None:
        state, following = next(states)
        replay.add(state, following, np.ones(1, np.int64), zero, zero, [{}])

    for _ in range(wanted.size):
        insert()
    return Filled(insert, lambda: replay.sample(BATCH))


class Peer(NamedTuple):
    """A replay that is compared."""

    make: Callable[[Wanted], Filled]
    package: str | None
    """Package that it comes from; None for this project."""
    rated: bool = True
    """Whether its prioritised draws are also compared."""


_STACKS = partial(cpprb, stack_compress=["obs", "next_obs"])
_STATES = partial(cpprb, stack_compress="obs", next_of="obs")
REPLAYS = {
    "ours": Peer(ours, None),
    "cpprb": Peer(cpprb, "cpprb", rated=False),
    "cpprb stack_compress": Peer(_STACKS, "cpprb"),
    "cpprb stack_compress next_of": Peer(_STATES, "cpprb"),
    "stable-baselines3": Peer(stable_baselines3, "stable_baselines3", rated=False),
}


class Replay:
    """One of `REPLAYS`, which can be measured; rates are per second."""

    def __init__(self, who: str, size: int, folder: str, prioritised: bool) -> None:
        torch.set_num_threads(1)  # two threads wait for each other on a busy machine
        self._filled = REPLAYS[who].make(Wanted(size, Path(folder), prioritised))

    def insert(self, seconds: float) -> float:
        return slice_per_second(self._filled.insert, seconds) * self._filled.steps

    def draw(self, seconds: float) -> float:
        return slice_per_second(self._filled.draw, seconds)


if __name__ == "__main__":
    serve(Replay)
