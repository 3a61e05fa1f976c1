"""Others' replays of Atari steps and ours behind one interface, for `benchmarks.peers`.

All are full of noise when they are made. Others take single steps with whole states, as their users
hand them in; ours takes chunks.
"""

from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import torch

from benchmarks.replay import BATCH, draw, draw_and_rate, fill, prioritised, unlimited
from benchmarks.synthetic import Streams
from replay.memory import Memory

_CHUNK = 64
_POOL = 64
_ALPHA, _BETA = 0.6, 0.4


class Filled(Protocol):
    """A full replay."""

    name: str
    steps: int
    """That one `insert` brings."""

    def insert(self) -> None:
        """Put something in, in the place of something old."""

    def draw(self) -> None:
        """Draw a batch, and give it new priorities if it has any."""


class Ours:
    """`Memory`, in files."""

    name = "ours"
    steps = _CHUNK

    def __init__(self, size: int, folder: Path, *, prioritised: bool = False) -> None:
        config = unlimited(size)
        self._memory = Memory(_prioritised(config) if prioritised else config, folder)
        self._streams = Streams("bench", actors=("actor-1",), steps=_CHUNK, history=4)
        fill(self._memory, self._streams, size)
        rated = draw_and_rate(self._memory, np.random.default_rng(1))
        self._draw = rated if prioritised else lambda: draw(self._memory)

    def insert(self) -> None:
        self._memory.insert(self._streams.next())

    def draw(self) -> None:
        self._draw()

    def close(self) -> None:
        """Close the files."""
        self._memory.close()


_prioritised = prioritised


class Cpprb:
    """cpprb's.

    Args:
        share: what is stored once: nothing (56 KB a step), the frames of each stack (14 KB), or
            also those of a state and the next (7 KB).
    """

    steps = 1

    def __init__(
        self,
        size: int,
        share: Literal["nothing", "stacks", "states"],
        *,
        prioritised: bool = False,
    ) -> None:
        import cpprb

        state = {"shape": (84, 84, 4), "dtype": np.uint8}
        layout = {
            "obs": state,
            "act": {"dtype": np.uint8},
            "rew": {"dtype": np.float32},
            "done": {"dtype": np.float32},
        }
        shared: dict[str, Any] = {}
        if share == "stacks":
            shared = {"stack_compress": ["obs", "next_obs"]}
        if share == "states":
            shared = {"stack_compress": "obs", "next_of": "obs"}
        else:
            layout["next_obs"] = state
        self.name = " ".join(("cpprb", *shared))
        self._prioritised = prioritised
        self._rng = np.random.default_rng(1)
        self._replay = (
            cpprb.PrioritizedReplayBuffer(size, layout, alpha=_ALPHA, **shared)
            if prioritised
            else cpprb.ReplayBuffer(size, layout, **shared)
        )
        self._states = self._rng.integers(256, size=(_POOL, 84, 84, 4), dtype=np.uint8)
        self._at = 0
        for _ in range(size):
            self.insert()

    def insert(self) -> None:
        self._at += 1
        self._replay.add(
            obs=self._states[self._at % _POOL],
            next_obs=self._states[(self._at + 1) % _POOL],
            act=1,
            rew=0.0,
            done=0.0,
        )

    def draw(self) -> None:
        if not self._prioritised:
            self._replay.sample(BATCH)
            return
        drawn = self._replay.sample(BATCH, beta=_BETA)
        self._replay.update_priorities(drawn["indexes"], self._rng.random(BATCH))


class StableBaselines3:
    """stable-baselines3's, as its DQN makes it."""

    name = "stable-baselines3"
    steps = 1

    def __init__(self, size: int) -> None:
        from gymnasium.spaces import Box, Discrete
        from stable_baselines3.common.buffers import ReplayBuffer

        self._replay: Any = ReplayBuffer(
            size, Box(0, 255, (4, 84, 84), np.uint8), Discrete(6), torch.device("cpu")
        )
        rng = np.random.default_rng(1)
        self._states = rng.integers(256, size=(_POOL, 1, 4, 84, 84), dtype=np.uint8)
        self._at = 0
        for _ in range(size):
            self.insert()

    def insert(self) -> None:
        self._at += 1
        self._replay.add(
            self._states[self._at % _POOL],
            self._states[(self._at + 1) % _POOL],
            np.array([1]),
            np.array([0.0]),
            np.array([0.0]),
            [{}],
        )

    def draw(self) -> None:
        self._replay.sample(BATCH)
