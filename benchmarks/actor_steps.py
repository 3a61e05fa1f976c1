"""`python -m benchmarks.actor_steps`: decisions per second of a whole actor on one core.

A real actor process on a core of its own plays by its network, streams all it lives through to a
replay process on the other cores, and sends its statistics. Nobody learns, so it is never held
back; the network is as it was first made, which takes as long to ask. The kinds of actor take
turns, so that a slow moment of the machine falls on all of them.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
import tyro

from benchmarks.child import end_as_by_ctrl_c, free_endpoint
from benchmarks.chunk_watch import ChunkWatch
from benchmarks.report import publish
from common.errors import InputError, exit_on_input_error
from common.process.supervisor import Child
from common.protocol.announcement import find_run
from common.run.config import EnvKind
from common.transport.bus import connect
from replay.client import RemoteReplay

_RUN = "bench"
_WARMUP = 256
_START = 120.0
_FIRST = 4
"""Chunks of each environment before a turn's window begins."""
_TITLES: dict[EnvKind, str] = {"ale": "ALE-Only", "robot": "robot"}


@dataclass(frozen=True)
class Options:
    """Time whole actors: environment, network, stream and statistics."""

    game: str = "pong"
    """Any game that ale-py bundles."""
    envs: tuple[int, ...] = (1, 2, 4)
    """Numbers of environments in the process, each measured."""
    seconds: float = 5.0
    """Of each turn; starting takes as long again."""
    turns: int = 3
    """Turns of each kind of actor."""
    json: Path | None = None
    """File for the results."""

    def check(self) -> None:
        if not self.envs or min(*self.envs, self.turns) < 1 or not self.seconds > 0:
            raise InputError("choose 1 or more environments and turns, and seconds above 0.")


class Mark(NamedTuple):
    """The moment at which a chunk was accepted."""

    at: float
    agent_steps: int


class Hub:
    """A replay that never asks its actors to wait; a context manager that ends it.

    Args:
        folder: for what it keeps.
        core: that its actors have.
    """

    def __init__(self, env: EnvKind, game: str, folder: Path, core: int) -> None:
        self._core = core
        self._endpoint = free_endpoint()
        self._actors = 0
        self._process = Child(
            "replay",
            *("--env", env, "--game", game),
            *("--run", _RUN, "--runs", str(folder / env), "--listen", self._endpoint),
            *("--replay.capacity", "20000", "--replay.learning-starts", str(_WARMUP)),
            *("--replay.ratio-tolerance", str(10**9)),
            # Past the warm-up ε is what it is for most of a run: the network chooses.
            *("--exploration.steps", "1"),
            stdout=subprocess.DEVNULL,
        )

    def __enter__(self) -> Self:
        try:
            self._session = connect(self._endpoint, _START, self._is_over)
            keys, config = find_run(self._session, _RUN, _START, self._is_over)
        except BaseException:
            self._process.end()
            raise
        self._watch = ChunkWatch(RemoteReplay(self._session, keys, config))
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()  # type: ignore[no-untyped-call]
        self._process.end()

    def _is_over(self) -> bool:
        return self._process.poll() is not None

    def steps_per_second(self, envs: int, seconds: float) -> float:
        """Of a new actor with so many environments, watched for so long.

        Raises:
            InputError: the actor failed, and has said why.
        """
        self._actors += 1
        name = f"actor-{self._actors}"
        arguments = ["--connect", self._endpoint, "--name", name, "--envs", str(envs)]
        actor = Child("actors", *arguments, stderr=subprocess.PIPE)
        os.sched_setaffinity(actor.pid, {self._core})  # before it has threads, which inherit it
        try:
            for _ in range(_FIRST * envs):
                begin = self._next_chunk(name, actor)
            time.sleep(seconds)
            self._next_chunk(name, actor)  # one that may have come long since
            finish = self._next_chunk(name, actor)
        finally:
            actor.end()
        return (finish.agent_steps - begin.agent_steps) / (finish.at - begin.at)

    def _next_chunk(self, name: str, actor: Child) -> Mark:
        """The moment at which the actor's next chunk is accepted."""

        def check() -> None:
            if actor.poll() is not None:
                raise actor.failure("actor")

        while True:
            now, facts = self._watch.next(check)
            if facts[-1].actor == name:
                return Mark(now, facts[-1].agent_steps)


def measure(options: Options) -> dict[tuple[EnvKind, int], list[float]]:
    """Decisions per second, turn by turn, by kind and number of environments."""
    found: dict[tuple[EnvKind, int], list[float]] = {
        (env, envs): [] for env in _TITLES for envs in options.envs
    }
    with (
        tempfile.TemporaryDirectory(prefix="ale-robot-bench-") as folder,
        _one_core_set_apart() as core,
        ExitStack() as stack,
    ):
        hubs = {
            env: stack.enter_context(Hub(env, options.game, Path(folder), core)) for env in _TITLES
        }
        for turn in range(options.turns):
            for (env, envs), rates in found.items():
                rates.append(hubs[env].steps_per_second(envs, options.seconds))
            print(f"turn {turn + 1} of {options.turns}", file=sys.stderr, flush=True)
    return found


@contextmanager
def _one_core_set_apart() -> Iterator[int]:
    """A core that this process, and those that it starts, leave alone; the only one, if need be."""
    usable = os.sched_getaffinity(0)
    core = max(usable)
    os.sched_setaffinity(0, usable - {core} or usable)
    try:
        yield core
    finally:
        os.sched_setaffinity(0, usable)


def main() -> None:
    options = tyro.cli(Options, prog="python -m benchmarks.actor_steps")
    options.check()
    end_as_by_ctrl_c()
    found = measure(options)
    publish(
        f"{options.game}: decisions per second of an actor on one core, with network, stream and "
        "statistics, while the replay has the others",
        [
            {
                "kind": _TITLES[env],
                "environments": envs,
                "per second": float(np.median(rates)),
                "least": min(rates),
                "most": max(rates),
            }
            for (env, envs), rates in found.items()
        ],
        options.json,
        {
            env: {str(envs): float(np.median(found[env, envs])) for envs in options.envs}
            for env in _TITLES
        },
    )


if __name__ == "__main__":
    exit_on_input_error(main)
