"""Others' replays of Atari steps and ours behind one interface, for `benchmarks.peers`.

All are full of noise when they are made. Others take single steps with whole states, as their users
hand them in; ours takes chunks. Each is measured in a process of its own: what a batch costs
depends on what the process has allocated before, up to tenfold.
"""

import itertools
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
import tyro
from numpy.typing import NDArray

from benchmarks.child import Helper
from benchmarks.pace import slice_per_second
from benchmarks.replay import BATCH, draw, draw_and_rate, fill, prioritised, unlimited
from benchmarks.synthetic import Streams
from replay.replay_buffer import ReplayBuffer

_CHUNK = 64
_POOL = 64
_ALPHA, _BETA = 0.6, 0.4
Who = Literal["ours", "cpprb", "cpprb-stacks", "cpprb-states", "stable-baselines3"]


@dataclass(frozen=True)
class Options:
    """Answer each line ``insert SECONDS`` or ``draw SECONDS`` with a rate per second."""

    who: Who
    size: int
    folder: Path
    prioritised: bool = False


class Filled(NamedTuple):
    """A full replay."""

    insert: Callable[[], object]
    """Puts something in, in the place of something old."""
    draw: Callable[[], object]
    """Draws a batch, and gives it new priorities if it has any."""
    steps: int = 1
    """Steps that an insert brings."""


def ours(options: Options) -> Filled:
    """`ReplayBuffer`, in files."""
    config = unlimited(options.size)
    memory = ReplayBuffer(prioritised(config) if options.prioritised else config, options.folder)
    streams = Streams("bench", actors=("actor-1",), steps=_CHUNK, frame_stack=4)
    fill(memory, streams, options.size)
    rated = draw_and_rate(memory, np.random.default_rng(1))
    return Filled(
        lambda: memory.insert(streams.next()),
        rated if options.prioritised else lambda: draw(memory),
        _CHUNK,
    )


def _states(*shape: int) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
    """Yields a state of noise and the next one, without end."""
    pool = np.random.default_rng(1).integers(256, size=(_POOL, *shape), dtype=np.uint8)
    return itertools.pairwise(itertools.cycle(pool))


def cpprb(options: Options, **shared: Any) -> Filled:
    """cpprb's.

    Args:
        shared: what is stored once. Without it a step takes 56 KB, with the frames of each stack
            once 14 KB, and with those of a state and the next once 7 KB.
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

    if options.prioritised:
        replay = cpprb.PrioritizedReplayBuffer(options.size, layout, alpha=_ALPHA, **shared)
    else:
        replay = cpprb.ReplayBuffer(options.size, layout, **shared)
    for _ in range(options.size):
        insert()
    return Filled(insert, rated if options.prioritised else lambda: replay.sample(BATCH))


def stable_baselines3(options: Options) -> Filled:
    """stable-baselines3's, as its DQN makes it; it has no priorities."""
    from gymnasium.spaces import Box, Discrete
    from stable_baselines3.common.buffers import ReplayBuffer

    replay: Any = ReplayBuffer(
        options.size, Box(0, 255, (4, 84, 84), np.uint8), Discrete(6), torch.device("cpu")
    )
    states, zero = _states(1, 4, 84, 84), np.zeros(1)

    def insert() -> None:
        state, following = next(states)
        replay.add(state, following, np.ones(1, np.int64), zero, zero, [{}])

    for _ in range(options.size):
        insert()
    return Filled(insert, lambda: replay.sample(BATCH))


class Peer(NamedTuple):
    """A replay that is compared."""

    name: str
    make: Callable[[Options], Filled]
    package: str | None
    """That it comes from, if it is not this one."""
    rated: bool = True
    """Whether its prioritised draws are compared too."""


_STACKS = partial(cpprb, stack_compress=["obs", "next_obs"])
_STATES = partial(cpprb, stack_compress="obs", next_of="obs")
REPLAYS: dict[Who, Peer] = {
    "ours": Peer("ours", ours, None),
    "cpprb": Peer("cpprb", cpprb, "cpprb", rated=False),
    "cpprb-stacks": Peer("cpprb stack_compress", _STACKS, "cpprb"),
    "cpprb-states": Peer("cpprb stack_compress next_of", _STATES, "cpprb"),
    "stable-baselines3": Peer(
        "stable-baselines3", stable_baselines3, "stable_baselines3", rated=False
    ),
}


class Elsewhere(Helper):
    """A replay in a process of its own; a context manager that ends it."""

    def __init__(self, who: Who, size: int, folder: Path, *, prioritised: bool = False) -> None:
        super().__init__(
            REPLAYS[who].name,
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
    replay = REPLAYS[options.who].make(options)
    for line in sys.stdin:
        work, seconds = line.split()
        action, units = (replay.insert, replay.steps) if work == "insert" else (replay.draw, 1)
        print(slice_per_second(action, float(seconds)) * units, flush=True)


if __name__ == "__main__":
    main()
