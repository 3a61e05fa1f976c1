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
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import tyro
import zenoh

from actors.stream.insert_client import InsertClient
from benchmarks.synthetic import Streams
from common.errors import exit_on_input_error
from common.process.allocator import keep_large_blocks
from common.protocol.announcement import find_run
from common.protocol.run_keys import RunKeys
from common.run.config import RunConfig
from common.transport.bus import connect
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


class TimedOutbox(InsertClient):
    """An outbox that notes how long each chunk was on its way."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.latencies: list[float] = []
        """Seconds from a chunk's (latest) sending to its acknowledgement."""

    def _post(self, letter: Any) -> None:
        letter.sent = time.perf_counter()
        super()._post(letter)

    def _settle(self, letter: Any, reply: zenoh.Reply) -> bool:
        now = time.perf_counter()
        settled = super()._settle(letter, reply)
        if settled:
            self.latencies.append(now - letter.sent)
        return settled


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
    session: zenoh.Session, keys: RunKeys, config: RunConfig, options: Options
) -> dict[str, Any]:
    """Encode and send chunks, as fast as the window lets it."""
    outbox = TimedOutbox(
        session,
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
        **_rates(calls, seconds, outbox.latencies[-calls:]),
        "transitions_per_second": calls * config.stream.chunk_steps / seconds,
        "megabytes_per_second": calls * size / seconds / 1e6,
        "retried": outbox.retried,
        "refused": outbox.refused,
        "unacknowledged": outbox.unacknowledged,
    }


def draw(
    session: zenoh.Session, keys: RunKeys, config: RunConfig, options: Options
) -> dict[str, Any]:
    """Draw batches one after the other; megabytes are those learned from, made whole."""
    replay = RemoteReplay(session, keys, config)
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
        size = sum(array.nbytes for array in batch)
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
    session = connect(options.connect, _PATIENCE)
    try:
        keys, config = find_run(session, options.run, _PATIENCE, lambda: False)
        part = send if options.role == "send" else draw
        print(json.dumps(part(session, keys, config, options)), flush=True)
    finally:
        session.close()  # type: ignore[no-untyped-call]


if __name__ == "__main__":
    exit_on_input_error(main)
