"""What may go wrong: each fault strikes one process or link, and returns what ends it."""

import random
from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

from benchmarks.chaos.cluster import HUB, LEARNER, RUN, Cluster
from common.errors import MessageError
from common.run.join import find_run
from common.transport.interface import Unanswered

_JUNK = 20
"""Messages that nobody should have sent."""

End = Callable[[], None]


class Fault(NamedTuple):
    """A kind of fault."""

    strike: Callable[[Cluster, str, random.Random], End | None]
    """Breaks the target; returns what mends it, or None if that mends itself."""
    targets: Callable[[Cluster], tuple[str, ...]]
    seconds: tuple[float, float] = (0.0, 0.0)
    """The least and the most that it lasts."""
    may_end: bool = False
    """Whether a process may end by it, to be started again."""


def _kill(cluster: Cluster, name: str, _: random.Random) -> None:
    cluster.kill(name)


def _pause(cluster: Cluster, name: str, _: random.Random) -> End:
    return cluster.pause(name)


def _rejoin(cluster: Cluster, name: str, _: random.Random) -> None:
    cluster.rejoin(name)


def _double(cluster: Cluster, name: str, _: random.Random) -> End:
    return cluster.double(name).end


def _cut(cluster: Cluster, name: str, _: random.Random) -> End:
    cluster.links[name].cut()
    return cluster.links[name].mend


def _half_open(cluster: Cluster, name: str, _: random.Random) -> End:
    link = cluster.links[name]
    link.cut()

    def end() -> None:
        link.reset()
        link.mend()

    return end


def _reset(cluster: Cluster, name: str, _: random.Random) -> None:
    cluster.links[name].reset()


def _delay(cluster: Cluster, name: str, draw: random.Random) -> End:
    cluster.links[name].delay = draw.uniform(0.02, 0.3)
    return cluster.links[name].mend


def _flip(cluster: Cluster, name: str, draw: random.Random) -> End:
    cluster.links[name].flips = random.Random(draw.random())
    return cluster.links[name].mend


def _junk(cluster: Cluster, name: str, draw: random.Random) -> None:
    """Send what is no chunk to the replay in an actor's name; each must be refused."""
    keys, _ = find_run(cluster.transport, RUN, 60.0, lambda: False)
    requester = cluster.transport.requester(keys.insert(name), 10.0)
    for _ in range(_JUNK):
        with suppress(MessageError, Unanswered):
            requester.request(draw.randbytes(draw.randrange(1, 5_000))).result()
            raise AssertionError("junk was stored")
    requester.close()


def _everyone(cluster: Cluster) -> tuple[str, ...]:
    return (HUB, LEARNER, *cluster.actors)


def _clients(cluster: Cluster) -> tuple[str, ...]:
    return (LEARNER, *cluster.actors)


def _actors(cluster: Cluster) -> tuple[str, ...]:
    return cluster.actors


FAULTS = {
    "kill -9": Fault(_kill, _everyone),
    "pause (SIGSTOP)": Fault(_pause, _everyone, (1.0, 12.0)),
    "leave and join": Fault(_rejoin, _actors),
    "same name twice": Fault(_double, _actors, (4.0, 8.0)),
    "network away, what was sent arrives later": Fault(_cut, _clients, (1.0, 12.0)),
    "half-open connection": Fault(_half_open, _clients, (1.0, 12.0)),
    "connection reset": Fault(_reset, _clients),
    "slow network, 20 to 300 ms": Fault(_delay, _clients, (2.0, 6.0)),
    # Zenoh's own messages have no checksum: some wrong bits in them make it panic.
    "one wrong bit in each piece": Fault(_flip, _clients, (1.0, 3.0), may_end=True),
    "junk in an actor's name": Fault(_junk, _actors),
}
"""By what people call them."""
