"""Others' replays of Atari steps and ours behind one interface, for `benchmarks.peers`.

All are full of noise when they are made. Others take single steps with whole states, as their users
hand them in; ours takes chunks. Each is measured in a process of its own: what a batch costs
depends on what the process has allocated before, up to tenfold.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import torch
import tyro

from benchmarks.child import Helper
from benchmarks.pace import slice_per_second
from benchmarks.replay import BATCH, draw, draw_and_rate, fill, prioritised, unlimited
from benchmarks.synthetic import Streams
from replay.replay_buffer import ReplayBuffer

_CHUNK = 64
_POOL = 64
_ALPHA, _BETA = 0.6, 0.4


class Filled(Protocol):
    """A full replay."""

    steps: int
    """That one `insert` brings."""

    def insert(self) -> None:
        """Put something in, in the place of something old."""

    def draw(self) -> None:
        """Draw a batch, and give it new priorities if it has any."""


class Ours:
    """`ReplayBuffer`, in files."""

    steps = _CHUNK

    def __init__(self, size: int, folder: Path, *, prioritised: bool = False) -> None:
        config = unlimited(size)
        self._memory = ReplayBuffer(_prioritised(config) if prioritised else config, folder)
        self._streams = Streams("bench", actors=("actor-1",), steps=_CHUNK, frame_stack=4)
        fill(self._memory, self._streams, size)
        rated = draw_and_rate(self._memory, np.random.default_rng(1))
        self._draw = rated if prioritised else lambda: draw(self._memory)

    def insert(self) -> None:
        self._memory.insert(self._streams.next())

    def draw(self) -> None:
        self._draw()


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


Who = Literal["ours", "cpprb", "cpprb-stacks", "cpprb-states", "stable-baselines3"]
NAMES: dict[Who, str] = {
    "ours": "ours",
    "cpprb": "cpprb",
    "cpprb-stacks": "cpprb stack_compress",
    "cpprb-states": "cpprb stack_compress next_of",
    "stable-baselines3": "stable-baselines3",
}


@dataclass(frozen=True)
class Options:
    """Answer each line ``insert SECONDS`` or ``draw SECONDS`` with a rate per second."""

    who: Who
    size: int
    folder: Path
    prioritised: bool = False


def make(options: Options) -> Filled:
    """The replay that is asked for; uniform ones only from stable-baselines3."""
    size, prioritised = options.size, options.prioritised
    if options.who == "ours":
        return Ours(size, options.folder, prioritised=prioritised)
    if options.who == "stable-baselines3":
        return StableBaselines3(size)
    if options.who == "cpprb":
        return Cpprb(size, "nothing", prioritised=prioritised)
    share: Literal["stacks", "states"] = "stacks" if options.who == "cpprb-stacks" else "states"
    return Cpprb(size, share, prioritised=prioritised)


class Elsewhere(Helper):
    """A replay in a process of its own; a context manager that ends it."""

    def __init__(self, who: Who, size: int, folder: Path, *, prioritised: bool = False) -> None:
        super().__init__(
            NAMES[who],
            "benchmarks.peer_replays",
            *("--who", who, "--size", str(size), "--folder", str(folder)),
            "--prioritised" if prioritised else "--no-prioritised",
        )

    def rate(self, work: Literal["insert", "draw"], seconds: float) -> float:
        """Returns steps inserted, or batches drawn, per second.

        Raises:
            InputError: the process failed, and has said why.
        """
        self.say(f"{work} {seconds}")
        return float(self.hear())


def main() -> None:
    options = tyro.cli(Options, prog="python -m benchmarks.peer_replays")
    torch.set_num_threads(1)  # two wait for each other on a busy machine
    replay = make(options)
    for line in sys.stdin:
        work, seconds = line.split()
        action, units = (replay.insert, replay.steps) if work == "insert" else (replay.draw, 1)
        print(slice_per_second(action, float(seconds)) * units, flush=True)


if __name__ == "__main__":
    main()
