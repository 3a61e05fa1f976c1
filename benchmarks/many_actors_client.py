"""`python -m benchmarks.many_actors_client`: the actors of `benchmarks.many_actors`, one process.

Each has a session, a name and an insert client of its own, as on a machine of its own; only the
robot is missing: chunks of noise are due at the pace of a robot in real time.
"""

import json
import sys
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass

import tyro

from actors.member import Member
from actors.stream.insert_client import InsertClient
from benchmarks.synthetic import Streams
from benchmarks.transport_client import time_requests
from common.errors import exit_on_input_error
from common.protocol.run_keys import RunKeys
from common.run.config import RunConfig
from common.run.join import find_run
from common.transport.interface import Envelope, Transport
from common.transport.zenoh_transport import connect

_PATIENCE = 60.0
_FLUSH = 30.0
_BROADCAST = 10.0
"""Seconds after which weights have been dropped by the way, as they are where a link is full."""


@dataclass(frozen=True)
class Options:
    """Be many actors for some seconds."""

    actors: int
    connect: str
    run: str
    seconds: float
    period: float
    """Seconds from one chunk of an actor to its next."""


class Arrivals:
    """The moments at which broadcast weights arrived, on the machine's monotonic clock."""

    def __init__(self, expected: int) -> None:
        self._moments: list[float] = []
        self._lock = threading.Lock()
        self._expected = expected
        self._all = threading.Event()

    def note(self, _: Envelope) -> None:
        """An actor got them."""
        with self._lock:
            self._moments.append(time.monotonic())
            if len(self._moments) == self._expected:
                self._all.set()

    def wait(self) -> list[float]:
        """Returns the moments, in order, when all actors have the weights or none come any more."""
        self._all.wait(_BROADCAST)
        with self._lock:
            return sorted(self._moments)


def play(clients: list[InsertClient], streams: Streams, options: Options) -> tuple[int, int, float]:
    """Hands in chunks when they are due, each actor's shifted against the others'.

    Returns:
        Chunks; those held back because the actor's window was full, which a robot would have waited
        for; and the seconds that the last chunk was late.
    """
    due = int(options.seconds / options.period * len(clients))
    began, held_back = time.monotonic(), 0
    for n in range(due):
        client = clients[n % len(clients)]
        wait = began + n * options.period / len(clients) - time.monotonic()
        if wait > 0:
            time.sleep(wait)
        payload = streams.next().encode()
        held_back += client.unacknowledged >= client.window
        client.send(payload)
    late = time.monotonic() - began - (due - 1) * options.period / len(clients)
    for client in clients:
        client.flush(_FLUSH)
    return due, held_back, late


def main() -> None:
    options = tyro.cli(Options, prog="python -m benchmarks.many_actors_client")
    names = tuple(f"actor-{n}" for n in range(options.actors))
    arrivals = Arrivals(options.actors)

    def join(name: str, transport: Transport, keys: RunKeys, config: RunConfig) -> InsertClient:
        latencies.append(time_requests(transport))
        transport.subscribe(keys.weights, arrivals.note)
        return InsertClient(Member(name, transport, keys, config, _PATIENCE, threading.Event()))

    latencies: list[list[float]] = []
    with ExitStack() as stack:
        began = time.monotonic()
        clients = []
        for name in names:
            transport = stack.enter_context(connect(options.connect, _PATIENCE))
            keys, config = find_run(transport, options.run, _PATIENCE, lambda: False)
            clients.append(join(name, transport, keys, config))
        streams = Streams(
            keys.run_id,
            actors=names,
            steps=config.stream.chunk_steps,
            frame_stack=config.play.frame_stack,
        )
        print(json.dumps({"join_seconds": time.monotonic() - began}), flush=True)
        sys.stdin.readline()
        spent = time.process_time()
        chunks, held_back, late = play(clients, streams, options)
        told = {
            "chunks": chunks,
            "held_back": held_back,
            "late_seconds": late,
            "cpu_seconds": time.process_time() - spent,
            "latencies": [each for actor in latencies for each in actor],
            "acknowledged": sum(each.acked for each in clients),
            "sent_again": sum(each.retried for each in clients),
        }
        print(json.dumps(told), flush=True)
        sys.stdin.readline()
        print(json.dumps({"arrivals": arrivals.wait()}), flush=True)
        sys.stdin.readline()


if __name__ == "__main__":
    exit_on_input_error(main)
