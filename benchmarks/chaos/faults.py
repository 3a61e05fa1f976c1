"""The faults: each strikes one process or link, and returns a function that ends it."""

import itertools
import random
from collections.abc import Callable
from contextlib import suppress
from operator import attrgetter
from typing import NamedTuple

from benchmarks.chaos.cluster import EVALUATOR, HUB, LEARNER, Cluster
from common.errors import MessageError
from common.exit_codes import BAD_INPUT
from common.run.join import find_run
from common.transport.interface import Unanswered

PATIENCE = 120.0
"""Seconds after which a run counts as not recovered."""
_JUNK = 20
"""Number of malformed messages that are sent."""
_DAY = 86_400
_RESENT_AFTER = 0.2
"""Seconds after which Linux first resends an unacknowledged piece."""
_MAX_RESENT = 4

End = Callable[[], None]


class Fault(NamedTuple):
    strike: Callable[[Cluster, str, random.Random], End | None]
    """Breaks the target; returns a function that mends it, or None if it mends itself."""
    targets: Callable[[Cluster], tuple[str, ...]]
    seconds: tuple[float, float] = (0.0, 0.0)
    """Minimum and maximum duration."""
    may_end: bool = False
    """Whether the fault may end a process, which is then started again."""
    missing: Callable[[Cluster], str | None] = lambda _: None
    """Returns why it cannot strike on this machine; None if it can."""


def _half_open(cluster: Cluster, name: str, _: random.Random) -> End:
    link = cluster.links[name]
    mend = link.cut()

    def end() -> None:
        link.reset()
        mend()

    return end


def _delay(cluster: Cluster, name: str, draw: random.Random) -> End:
    seconds = draw.uniform(0.02, 0.3)
    cluster.links[name].delay = lambda: seconds
    return cluster.links[name].mend


def _lose(cluster: Cluster, name: str, draw: random.Random) -> End:
    """Loses some pieces, and some that are sent again; TCP waits twice as long each time."""
    share, losses = draw.uniform(0.02, 0.3), random.Random(draw.random())

    def delay() -> float:
        waits = itertools.takewhile(lambda _: losses.random() < share, range(_MAX_RESENT))
        return sum(_RESENT_AFTER * 2.0**again for again in waits)

    cluster.links[name].delay = delay
    return cluster.links[name].mend


def _flip(cluster: Cluster, name: str, draw: random.Random) -> End:
    cluster.links[name].flips = random.Random(draw.random())
    return cluster.links[name].mend


def _junk(cluster: Cluster, name: str, draw: random.Random) -> None:
    """Sends malformed chunks to the replay in an actor's name; each must be refused."""
    keys, _ = find_run(cluster.transport, None, 60.0)
    requester = cluster.transport.requester(keys.insert(name), 10.0)
    for _ in range(_JUNK):
        with suppress(MessageError, Unanswered):
            requester.request(draw.randbytes(draw.randrange(1, 5_000))).result()
            raise AssertionError("junk was stored")
    requester.close()


def _jump(cluster: Cluster, name: str, draw: random.Random) -> End:
    cluster.clocks.set(name, draw.choice((-1, 1)) * draw.randrange(60, 30 * _DAY))
    return lambda: cluster.clocks.set(name, 0)


def _expire(cluster: Cluster, name: str, _: random.Random) -> End:
    """Lets a certificate expire: its process must be refused, and the others keep working."""
    cluster.certificates.expire(name)
    if name == HUB:
        cluster.kill(name)  # a process reads its own certificate only at its start
    else:
        cluster.links[name].reset()
    if not cluster.is_refused(name):
        raise AssertionError(f"an expired certificate of {name} was accepted")
    # Without a learner the actors soon have to wait.
    if name not in (HUB, LEARNER) and cluster.recovery(PATIENCE, besides=name) is None:
        raise AssertionError(f"the other processes did not keep working without {name}")
    chunks, weights, tests = cluster.stored(), cluster.published, cluster.tests()

    def end() -> None:
        now = cluster.stored()
        came = [each for each in cluster.actors if now.get(each) != chunks.get(each)]
        if name in came or (name == HUB and came):
            raise AssertionError(f"chunks came in spite of the expired certificate of {name}")
        if name in (HUB, LEARNER) and cluster.published != weights:
            raise AssertionError(f"weights came in spite of the expired certificate of {name}")
        # One test may have ended before, and be recorded only now.
        if name == EVALUATOR and len(cluster.tests() - tests) > 1:
            raise AssertionError(f"tests came in spite of the expired certificate of {name}")
        cluster.certificates.renew(name)
        if name == HUB:
            cluster.kill(name)

    return end


def _old(cluster: Cluster, name: str, __: random.Random) -> None:
    """Starts an actor of a former version: it must be refused with an explanation."""
    process = cluster.old_actor(name)
    said, _ = process.communicate(timeout=PATIENCE)
    if process.returncode != BAD_INPUT or "the hub does not speak this version's" not in said:
        raise AssertionError(f"a former version ended with {process.returncode}, and said: {said}")


_everyone, _clients, _actors = attrgetter("everyone"), attrgetter("clients"), attrgetter("actors")


def _the_disk(_: Cluster) -> tuple[str, ...]:
    return ("disk",)


FAULTS = {
    "kill -9": Fault(lambda run, name, _: run.kill(name), _everyone),
    "pause (SIGSTOP)": Fault(lambda run, name, _: run.pause(name), _everyone, (1.0, 12.0)),
    "leave and join": Fault(lambda run, name, _: run.rejoin(name), _actors),
    "same name twice": Fault(lambda run, name, _: run.double(name).end, _actors, (1.0, 4.0)),
    "network away, what was sent arrives later": Fault(
        lambda run, name, _: run.links[name].cut(), _clients, (1.0, 12.0)
    ),
    "half-open connection": Fault(_half_open, _clients, (1.0, 12.0)),
    "router restart, connection forgotten": Fault(
        lambda run, name, _: run.links[name].forget(), _clients
    ),
    "connection reset": Fault(lambda run, name, _: run.links[name].reset(), _clients),
    "slow network, 20 to 300 ms": Fault(_delay, _clients, (2.0, 6.0)),
    "packet loss, 2 to 30 %": Fault(_lose, _clients, (2.0, 6.0)),
    # Zenoh's own messages have no checksum, and some wrong bits make it panic. TLS has a checksum.
    "one wrong bit in each piece": Fault(_flip, _clients, (1.0, 3.0), may_end=True),
    "junk in an actor's name": Fault(_junk, _actors),
    "disk full": Fault(
        lambda run, *_: run.disk.fill(), _the_disk, (1.0, 6.0), missing=attrgetter("disk.missing")
    ),
    "disk read-only": Fault(
        lambda run, *_: run.disk.forbid(), _the_disk, (1.0, 6.0), missing=attrgetter("disk.missing")
    ),
    "clock a minute to a month off": Fault(
        _jump, attrgetter("clocked"), (1.0, 6.0), missing=attrgetter("clocks.missing")
    ),
    "certificate expired": Fault(
        _expire, _everyone, (1.0, 6.0), missing=attrgetter("no_certificates")
    ),
    "old version of the program": Fault(_old, _actors, missing=attrgetter("old_version.missing")),
}
"""All faults by their names for people."""
