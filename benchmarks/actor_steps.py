"""`python -m benchmarks.actor_steps`: agent steps per second of a whole actor on one core.

A real actor process on a core of its own plays by its network, streams its transitions to a replay
process on the other cores, and sends its statistics. No learner runs, so the actor is never
throttled. The network has its initial weights, which take as long to evaluate as trained ones, and
without which an actor would play at random. The kinds of actor take turns.
"""

import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import partial

from benchmarks.hosted_run import NEVER, HostedRun
from benchmarks.pace import Spread, in_turns
from benchmarks.report import BenchmarkOptions, Numbers, Report, Seconds, main
from common.checked import FromOne
from common.network import build_network
from common.process.supervisor import Child
from common.protocol.weights import encode_weights
from common.protocol.wire import encode_version

_WARMUP = 256
_FIRST = 4
"""Chunks that each environment sends before a turn's window begins."""
_VERSION = 1
"""Version of the weights: number of updates that made them."""
_TITLES: dict[str, str] = {"ale": "ALE-Only", "robot": "robot"}


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Time whole actors: environment, network, stream and statistics."""

    game: str = "pong"
    """Any game that ale-py bundles."""
    envs: Numbers = (1, 2, 4)
    """Numbers of environments in the process; each is measured."""
    seconds: Seconds = 5.0
    """Length of each turn, in seconds; starting takes as long again."""
    turns: FromOne = 3
    """Number of turns of each kind of actor."""


class Hub(HostedRun):
    """A replay that never throttles its actors.

    Args:
        core: number of the core on which its actors run.
    """

    def __init__(self, env: str, game: str, core: int) -> None:
        super().__init__(
            "replay",
            *("--env", env, "--game", game),
            *("--replay.capacity", "20000", "--replay.learning-starts", str(_WARMUP)),
            *("--replay.ratio-tolerance", str(NEVER)),
            # After the initial steps ε has its final value, so that the network chooses.
            *("--exploration.steps", "1"),
        )
        self._core = core
        self._actors = 0

    def _watch(self, stack: ExitStack) -> None:
        publisher = stack.enter_context(closing(self.transport.publisher(self.keys.weights)))
        weights = encode_weights(build_network(self.config, self.config.action_count))
        publisher.publish(weights, encode_version(_VERSION, self.keys.run_id))

    def steps_per_second(self, envs: int, seconds: float) -> float:
        """Returns the agent steps per second of a new actor with ``envs`` environments.

        It is watched for ``seconds``.

        Raises:
            InputError: the actor failed and printed why.
        """
        self._actors += 1
        name = f"actor-{self._actors}"
        arguments = ["--connect", self.endpoint, "--name", name, "--envs", str(envs)]
        actor = Child("actors", *arguments, stderr=subprocess.PIPE)
        os.sched_setaffinity(actor.pid, {self._core})  # set early, so that its threads inherit it
        self.children["actor"] = actor
        try:
            for _ in range(_FIRST * envs):
                began, before = self._next_chunk(name)
            time.sleep(seconds)
            self._next_chunk(name)  # this one may have come long ago
            ended, steps = self._next_chunk(name)
        finally:
            del self.children["actor"]
            actor.end()
        return (steps - before) / (ended - began)

    def _next_chunk(self, name: str) -> tuple[float, int]:
        """Returns when an actor's next chunk was accepted, and the agent steps up to it."""
        while True:
            now, chunks = self.next_chunks()
            if chunks[-1].actor == name:
                return now, chunks[-1].agent_steps


def measure(options: Options) -> Report:
    with _one_core_set_apart() as core, ExitStack() as stack:
        contenders = {}
        for env in _TITLES:
            hub = stack.enter_context(Hub(env, options.game, core))
            for envs in options.envs:
                contenders[env, envs] = partial(hub.steps_per_second, envs, options.seconds)
        found = in_turns(contenders, options.turns, warm_up=0, tell=True)
    spreads = {kind: Spread.of(rates) for kind, rates in found.items()}
    return Report.of(
        f"{options.game}: agent steps per second of an actor on one core, with network, stream and "
        "statistics, while the replay has the others",
        [
            {"kind": _TITLES[env], "environments": envs, **spread.cells()}
            for (env, envs), spread in spreads.items()
        ],
        {env: {str(envs): spreads[env, envs].median for envs in options.envs} for env in _TITLES},
    )


@contextmanager
def _one_core_set_apart() -> Iterator[int]:
    """Yields a core that this process and its children leave alone, if there are two or more."""
    usable = os.sched_getaffinity(0)
    core = max(usable)
    os.sched_setaffinity(0, usable - {core} or usable)
    try:
        yield core
    finally:
        os.sched_setaffinity(0, usable)


if __name__ == "__main__":
    main("actor_steps", Options, measure)
