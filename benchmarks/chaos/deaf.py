"""`python -m benchmarks.chaos.deaf`: how long connections are silent after wrong bits.

Several clients at once send inserts to a hub, each through a link that flips one bit in each piece
of bytes for a moment. Zenoh's own messages have no checksum, so afterwards some clients no longer
find the server, or get no answer, although the connection stays. `LinkWatch` closes such a
connection, and Zenoh reconnects. Measured is the time from the end of the wrong bits until
everything that a client has asked is answered.
"""

import hashlib
import logging
import os
import random
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.chaos.link import Link
from benchmarks.child import free_endpoint
from benchmarks.report import BenchmarkOptions, Report, Seconds, main
from common.checked import Count, FromOne
from common.errors import InputError
from common.process.progress import Progress
from common.transport.chosen import connect, open_hub
from common.transport.interface import Request
from common.transport.link_watch import FIRST_PATIENCE
from common.transport.requests import Window

_PAYLOAD = 20_000
"""Bytes of an insert; a chunk of Pong has about as many."""
_WINDOW = 4
"""Inserts of a client that are under way at once, as an actor's."""
_PATIENCE = 5.0
"""Seconds that a request waits for its answer, as an actor's."""
_JOIN = 20.0
"""Maximum seconds until a client finds the hub."""


@dataclass(frozen=True, kw_only=True)
class Options(BenchmarkOptions):
    """Flip bits in many connections, and count those that answer no more."""

    connections: FromOne = 240
    """Number of connections."""
    clients: FromOne = 12
    """Number of clients at once; each has one connection after another."""
    wrong: Seconds = 0.5
    """Duration of the wrong bits in each connection, in seconds."""
    longest: Seconds = 90.0
    """Maximum time that a connection is watched after its wrong bits, in seconds."""
    seed: Count = 1
    """Seed of the bits; when each piece comes is chance."""


def measure(options: Options) -> Report:
    # Each damaged message is a warning, of which there are thousands here.
    logging.getLogger("common.transport").setLevel(logging.ERROR)
    endpoint = free_endpoint()
    seconds: list[float | None] = []
    with (
        open_hub(endpoint) as hub,
        ThreadPoolExecutor(options.clients) as pool,
        Progress("breaking", options.connections) as progress,
    ):
        hub.serve("run/*/insert", _accept)
        numbers = range(options.connections)
        for done in as_completed(pool.submit(break_one, options, endpoint, n) for n in numbers):
            seconds.append(done.result())
            progress.update(len(seconds), note=f"{len(seconds)} connections")
    return report(options, seconds)


def break_one(options: Options, endpoint: str, number: int) -> float | None:
    """Returns the seconds from the end of the wrong bits until everything is answered.

    None if that is not so after `Options.longest`.

    Raises:
        InputError: the client did not find the hub, before anything was broken.
    """
    with Link(endpoint) as link, connect(link.endpoint, _JOIN) as client:
        requester = client.requester(f"run/client-{number}/insert", _PATIENCE)
        window = Window(requester, lambda _: None)
        if not _becomes(lambda: requester.has_server, _JOIN):
            raise InputError(f"a client found no hub within {_JOIN:.0f} s: lower --clients.")
        link.flips = random.Random(options.seed + number)
        ends = time.monotonic() + options.wrong
        while time.monotonic() < ends:
            if len(window) < _WINDOW:
                window.send(os.urandom(_PAYLOAD))
            window.wait(_WINDOW - 1, 0.05)
        link.mend()
        mended = time.monotonic()
        answered = _becomes(lambda: window.wait(0, 0.2), options.longest)
        return time.monotonic() - mended if answered else None


def report(options: Options, seconds: Sequence[float | None]) -> Report:
    """Returns the report of the connections, one time of recovery each."""
    times = [each for each in seconds if each is not None]
    by_itself = [each for each in times if each < FIRST_PATIENCE]
    row: dict[str, Any] = {
        "connections": len(seconds),
        "median s": float(np.median(by_itself)) if by_itself else None,
        "deaf": len(seconds) - len(by_itself),
        "made anew": len(times) - len(by_itself),
        "longest s": max(times, default=None),
        "never": len(seconds) - len(times),
    }
    note = (
        f"Deaf: unanswered {FIRST_PATIENCE:.0f} s after the wrong bits, when a client may first "
        f"close its connection. Median: of all others. Never: not within {options.longest:.0f} s."
    )
    title = f"Connections after {options.wrong:g} s with one wrong bit in each piece of bytes"
    settings = {"clients": options.clients, "wrong_s": options.wrong, "seed": options.seed}
    return Report.of(title, [row], {**settings, "seconds": list(seconds)}, note)


def _accept(request: Request) -> bytes:
    return hashlib.sha256(request.payload).digest()


def _becomes(condition: Callable[[], bool], seconds: float) -> bool:
    """Returns whether ``condition`` holds within ``seconds``."""
    ends = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > ends:
            return False
        time.sleep(0.01)
    return True


if __name__ == "__main__":
    main("chaos.deaf", Options, measure)
