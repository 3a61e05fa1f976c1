"""What may go wrong: each fault strikes one process or link, and returns what ends it."""

import random
from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

from benchmarks.chaos.world import HUB, LEARNER, RUN, World
from common.errors import MessageError
from common.run.join import find_run
from common.transport.interface import Unanswered

_JUNK = 20
"""Messages that nobody should have sent."""

End = Callable[[], None]


class Fault(NamedTuple):
    """A kind of fault."""

    strike: Callable[[World, str, random.Random], End | None]
    """Breaks the target; returns what mends it, or None if that mends itself."""
    targets: Callable[[World], tuple[str, ...]]
    seconds: tuple[float, float] = (0.0, 0.0)
    """The least and the most that it lasts."""


def _kill(world: World, name: str, _: random.Random) -> None:
    world.kill(name)


def _pause(world: World, name: str, _: random.Random) -> End:
    return world.pause(name)


def _rejoin(world: World, name: str, _: random.Random) -> None:
    world.rejoin(name)


def _double(world: World, name: str, _: random.Random) -> End:
    return world.double(name).end


def _cut(world: World, name: str, _: random.Random) -> End:
    world.links[name].cut()
    return world.links[name].mend


def _half_open(world: World, name: str, _: random.Random) -> End:
    link = world.links[name]
    link.cut()

    def end() -> None:
        link.reset()
        link.mend()

    return end


def _reset(world: World, name: str, _: random.Random) -> None:
    world.links[name].reset()


def _delay(world: World, name: str, draw: random.Random) -> End:
    world.links[name].delay = draw.uniform(0.02, 0.3)
    return world.links[name].mend


def _flip(world: World, name: str, draw: random.Random) -> End:
    world.links[name].flips = random.Random(draw.random())
    return world.links[name].mend


def _junk(world: World, name: str, draw: random.Random) -> None:
    """Send what is no chunk to the replay in an actor's name; each must be refused."""
    keys, _ = find_run(world.transport, RUN, 60.0, lambda: False)
    requester = world.transport.requester(keys.insert(name), 10.0)
    for _ in range(_JUNK):
        with suppress(MessageError, Unanswered):
            requester.request(draw.randbytes(draw.randrange(1, 5_000))).result()
            raise AssertionError("junk was stored")
    requester.close()


def _everyone(world: World) -> tuple[str, ...]:
    return (HUB, LEARNER, *world.actors)


def _clients(world: World) -> tuple[str, ...]:
    return (LEARNER, *world.actors)


def _actors(world: World) -> tuple[str, ...]:
    return world.actors


FAULTS = {
    "kill -9": Fault(_kill, _everyone),
    "pause (SIGSTOP)": Fault(_pause, _everyone, (1.0, 12.0)),
    "leave and join": Fault(_rejoin, _actors),
    "same name twice": Fault(_double, _actors, (4.0, 8.0)),
    "network away, what was sent arrives later": Fault(_cut, _clients, (1.0, 12.0)),
    "half-open connection": Fault(_half_open, _clients, (1.0, 12.0)),
    "connection reset": Fault(_reset, _clients),
    "slow network, 20 to 300 ms": Fault(_delay, _clients, (2.0, 6.0)),
    "one wrong bit in each piece": Fault(_flip, _clients, (1.0, 3.0)),
    "junk in an actor's name": Fault(_junk, _actors),
}
"""By what people call them."""
