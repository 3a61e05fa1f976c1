"""`python -m benchmarks.transport_client`: one side of `benchmarks.transport`, as a process.

A sender hands in chunks through the actors' own outbox; a drawer draws batches through the
learner's own client, and gives them new priorities if they are prioritised. Each says ``ready``,
waits for a line on its standard input, works, and prints what it counted as a line of JSON.
"""

import json
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np
import tyro

from actors.stream.insert_client import InsertClient
from benchmarks.synthetic import Streams
from common.errors import exit_on_input_error
from common.process.allocator import keep_large_blocks
from common.protocol.run_keys import RunKeys
from common.run.config import RunConfig
from common.run.join import find_run
from common.transport.interface import Envelope, Requester, Transport, Unanswered
from common.transport.zenoh_transport import connect
from replay.client import RemoteReplay

_PATIENCE = 60.0
_FLUSH = 10.0
_WARM_UP = 0.3
"""Seconds before the counting."""


@dataclass(frozen=True)
class Options:
    """Send chunks, or draw batches."""

    role: Literal["send", "draw"]
    connect: str
    run: str
    seconds: float
    name: str = "sender"
    """The sender's."""
    window: int = 4
    """Chunks that the sender may have unacknowledged."""


class TimedTransport:
    """A transport whose requests' ways there and back are timed."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self.latencies: list[float] = []
        """Seconds from the sending of a request to its answer."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    def requester(self, key: str, deadline: float) -> "TimedRequester":
        return TimedRequester(self._transport.requester(key, deadline), self.latencies)


class TimedRequester:
    """Notes in ``latencies`` how long each request took that was answered."""

    def __init__(self, requester: Requester, latencies: list[float]) -> None:
        self._requester = requester
        self._latencies = latencies

    def __getattr__(self, name: str) -> Any:
        return getattr(self._requester, name)

    def request(self, payload: bytes) -> Future[Envelope]:
        sent = time.perf_counter()

        def note(future: Future[Envelope]) -> None:
            if not isinstance(future.exception(), Unanswered):
                self._latencies.append(time.perf_counter() - sent)

        future = self._requester.request(payload)
        future.add_done_callback(note)
        return future


def _work(action: Callable[[], None], options: Options) -> tuple[int, float]:
    """Calls of ``action`` and the seconds they took, after some that do not count."""
    print("ready", flush=True)
    sys.stdin.readline()
    began = time.perf_counter()
    while time.perf_counter() - began < _WARM_UP:
        action()
    calls, spent = 0, 0.0
    began = time.perf_counter()
    while spent < options.seconds:
        action()
        calls += 1
        spent = time.perf_counter() - began
    return calls, spent


def send(
    transport: Transport, keys: RunKeys, config: RunConfig, options: Options
) -> dict[str, Any]:
    """Encode and send chunks, as fast as the window lets it."""
    timed = TimedTransport(transport)
    outbox = InsertClient(
        cast(Transport, timed),
        keys.insert(options.name),
        options.window,
        patience=_PATIENCE,
        stopped=threading.Event().is_set,
        warn=lambda text: print(text, file=sys.stderr),
    )
    streams = Streams(
        keys.run,
        actors=(options.name,),
        steps=config.stream.chunk_steps,
        frame_stack=config.play.frame_stack,
    )
    size = 0

    def action() -> None:
        nonlocal size
        payload = streams.next().encode()
        size = len(payload)
        outbox.send(payload)

    calls, seconds = _work(action, options)
    outbox.flush(_FLUSH)
    return {
        **_rates(calls, seconds, timed.latencies[-calls:]),
        "transitions_per_second": calls * config.stream.chunk_steps / seconds,
        "megabytes_per_second": calls * size / seconds / 1e6,
        "retried": outbox.retried,
        "refused": outbox.refused,
        "unacknowledged": outbox.unacknowledged,
    }


def draw(
    transport: Transport, keys: RunKeys, config: RunConfig, options: Options
) -> dict[str, Any]:
    """Draw batches one after the other; megabytes are those learned from, made whole."""
    replay = RemoteReplay(transport, keys, config)
    rng = np.random.default_rng(1)
    latencies: list[float] = []
    size = 0

    def action() -> None:
        nonlocal size
        began = time.perf_counter()
        batch = replay.sample(0, _PATIENCE)
        latencies.append(time.perf_counter() - began)
        if batch is None:
            raise RuntimeError("no batch was to be had")
        size = sum(part.nbytes for part in batch if isinstance(part, np.ndarray))
        if config.replay.sampler == "prioritised":
            replay.update_priorities(batch.ids, rng.random(len(batch.ids)).astype(np.float32))

    calls, seconds = _work(action, options)
    return {
        **_rates(calls, seconds, latencies[-calls:]),
        "transitions_per_second": calls * config.learning.batch_size / seconds,
        "megabytes_per_second": calls * size / seconds / 1e6,
    }


def _rates(calls: int, seconds: float, latencies: list[float]) -> dict[str, Any]:
    return {
        "calls": calls,
        "seconds": seconds,
        "calls_per_second": calls / seconds,
        "p50_ms": float(np.percentile(latencies, 50)) * 1e3,
        "p99_ms": float(np.percentile(latencies, 99)) * 1e3,
    }


def main() -> None:
    options = tyro.cli(Options, prog="python -m benchmarks.transport_client")
    keep_large_blocks()
    with connect(options.connect, _PATIENCE) as transport:
        keys, config = find_run(transport, options.run, _PATIENCE, lambda: False)
        part = send if options.role == "send" else draw
        print(json.dumps(part(transport, keys, config, options)), flush=True)


if __name__ == "__main__":
    exit_on_input_error(main)
