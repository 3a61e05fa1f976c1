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
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import tyro

from actors.member import Member
from actors.stream.insert_client import InsertClient
from benchmarks.pace import repeat
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


def time_requests(transport: Transport) -> list[float]:
    """Returns a list to which each answered request of ``transport`` adds its seconds."""
    latencies: list[float] = []
    requester = transport.requester

    def timed_requester(key: str, deadline: float) -> Requester:
        made = requester(key, deadline)
        request = made.request

        def timed_request(payload: bytes) -> Future[Envelope]:
            sent = time.perf_counter()

            def note(future: Future[Envelope]) -> None:
                if not isinstance(future.exception(), Unanswered):
                    latencies.append(time.perf_counter() - sent)

            future = request(payload)
            future.add_done_callback(note)
            return future

        made.request = timed_request  # type: ignore[method-assign]
        return made

    transport.requester = timed_requester  # type: ignore[method-assign]
    return latencies


def figures(
    action: Callable[[], int], steps: int, latencies: list[float], options: Options
) -> dict[str, Any]:
    """Says that it is ready, waits for a line, repeats ``action``, and returns what it counted.

    Args:
        action: moves so many transitions, and returns their bytes.
        steps: transitions of each call.
        latencies: seconds of each call, which it adds to.
    """
    size = 0

    def sized() -> None:
        nonlocal size
        size = action()

    print("ready", flush=True)
    sys.stdin.readline()
    repeat(sized, _WARM_UP)
    calls, seconds = repeat(sized, options.seconds)
    p50, p99 = np.percentile(latencies[-calls:], (50, 99)).tolist()
    return {
        "calls": calls,
        "seconds": seconds,
        "calls_per_second": calls / seconds,
        "p50_ms": p50 * 1e3,
        "p99_ms": p99 * 1e3,
        "transitions_per_second": calls * steps / seconds,
        "megabytes_per_second": calls * size / seconds / 1e6,
    }


def send(
    transport: Transport, keys: RunKeys, config: RunConfig, options: Options
) -> dict[str, Any]:
    """Encode and send chunks, as fast as the window lets it."""
    latencies = time_requests(transport)
    windowed = replace(config, stream=replace(config.stream, window=options.window))
    outbox = InsertClient(
        Member(options.name, transport, keys, windowed, _PATIENCE, threading.Event())
    )
    steps = config.stream.chunk_steps
    streams = Streams(
        keys.run_id, actors=(options.name,), steps=steps, frame_stack=config.play.frame_stack
    )

    def action() -> int:
        payload = streams.next().encode()
        outbox.send(payload)
        return len(payload)

    found = figures(action, steps, latencies, options)
    outbox.flush(_FLUSH)
    return {
        **found,
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

    def action() -> int:
        began = time.perf_counter()
        batch = replay.sample(0, _PATIENCE)
        latencies.append(time.perf_counter() - began)
        if batch is None:
            raise RuntimeError("no batch was to be had")
        if config.replay.sampler == "prioritised":
            replay.update_priorities(batch.ids, rng.random(len(batch.ids)).astype(np.float32))
        return sum(part.nbytes for part in batch if isinstance(part, np.ndarray))

    return figures(action, config.learning.batch_size, latencies, options)


def main() -> None:
    options = tyro.cli(Options, prog="python -m benchmarks.transport_client")
    keep_large_blocks()
    with connect(options.connect, _PATIENCE) as transport:
        keys, config = find_run(transport, options.run, _PATIENCE, lambda: False)
        part = send if options.role == "send" else draw
        print(json.dumps(part(transport, keys, config, options)), flush=True)


if __name__ == "__main__":
    exit_on_input_error(main)
