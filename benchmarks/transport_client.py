"""The clients of `benchmarks.transport`, each a process of its own.

A sender sends chunks through the actors' own insert client. A drawer draws batches through the
learner's own client, and gives them new priorities if they are prioritised.
"""

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from actors.member import Member
from actors.stream.insert_client import InsertClient
from benchmarks.child import serve
from benchmarks.pace import repeat
from benchmarks.synthetic import camera_chunks
from common.process.allocator import keep_large_blocks
from common.run.join import find_run
from common.transport.chosen import connect
from common.transport.interface import Envelope, Requester, Transport, Unanswered
from replay.client import RemoteReplay

_PATIENCE = 60.0
_FLUSH = 10.0
_WARM_UP = 0.3
"""Seconds before counting begins."""


@dataclass
class Answers:
    """The answers to a transport's requests so far."""

    seconds: list[float] = field(default_factory=list)
    """Time until each came."""
    bytes: int = 0
    """Size of all."""


def count_answers(transport: Transport) -> Answers:
    """Returns what is counted of the answers to all requests of ``transport`` from now on."""
    answers = Answers()
    requester = transport.requester

    def counted_requester(key: str, deadline: float) -> Requester:
        made = requester(key, deadline)
        request = made.request

        def counted_request(payload: bytes) -> Future[Envelope]:
            sent = time.perf_counter()

            def note(future: Future[Envelope]) -> None:
                error = future.exception()
                if not isinstance(error, Unanswered):
                    answers.seconds.append(time.perf_counter() - sent)
                if error is None:
                    answers.bytes += len(future.result().payload)

            future = request(payload)
            future.add_done_callback(note)
            return future

        made.request = counted_request  # type: ignore[method-assign]
        return made

    transport.requester = counted_requester  # type: ignore[method-assign]
    return answers


class Client:
    """A process that joined a run.

    Args:
        window: maximum number of unacknowledged chunks.
    """

    def __init__(self, connect_to: str, run: str, name: str, window: int) -> None:
        keep_large_blocks()
        self._transport = connect(connect_to, _PATIENCE)
        self._keys, config = find_run(self._transport, run, _PATIENCE)
        self._config = replace(config, stream=replace(config.stream, window=window))
        self._name = name

    def prepare(self, role: str) -> None:
        """Makes the chunks of a sender; its return tells that this process has joined."""
        if role == "send":
            self._chunks = camera_chunks(self._keys.run_id, (self._name,), self._config)

    def send(self, seconds: float, pace: float | None) -> dict[str, Any]:
        """Encodes and sends chunks as fast as the window allows; returns the counts.

        Args:
            pace: maximum steps per second; None for no limit.
        """
        answers = count_answers(self._transport)
        inserts = InsertClient(
            Member(
                *(self._name, self._transport, self._keys, self._config),
                *(_PATIENCE, threading.Event()),
            )
        )
        chunks = self._chunks
        steps = self._config.stream.chunk_steps
        due = time.perf_counter()

        def action() -> int:
            nonlocal due
            if pace is not None:
                time.sleep(max(due - time.perf_counter(), 0.0))
                due += steps / pace
            payload = next(chunks).encode()
            inserts.send(payload)
            return len(payload)

        found = _figures(action, steps, answers.seconds, seconds)
        inserts.flush(_FLUSH)
        counted = ("retried", "refused", "unacknowledged")
        return found | {name: getattr(inserts, name) for name in counted}

    def draw(self, seconds: float) -> dict[str, Any]:
        """Draws batches one after the other; returns the counts.

        Megabytes are those of the batches on their way, compressed and with each frame once.
        """
        config = self._config
        answers = count_answers(self._transport)
        replay = RemoteReplay(self._transport, self._keys, config)
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
            arrived, answers.bytes = answers.bytes, 0
            return arrived

        return _figures(action, config.learning.batch_size, latencies, seconds)


def _figures(
    action: Callable[[], int], steps: int, latencies: list[float], seconds: float
) -> dict[str, Any]:
    """Repeats ``action`` for ``seconds``, and returns the counts.

    Args:
        action: moves ``steps`` transitions, and returns their bytes.
        steps: transitions per call.
        latencies: list to which each call adds its seconds.
    """
    size = 0

    def sized() -> None:
        nonlocal size
        size += action()

    repeat(sized, _WARM_UP)
    size = 0
    calls, spent = repeat(sized, seconds)
    p50, p99 = np.percentile(latencies[-calls:], (50, 99)).tolist()
    return {
        "calls": calls,
        "seconds": spent,
        "calls_per_second": calls / spent,
        "p50_ms": p50 * 1e3,
        "p99_ms": p99 * 1e3,
        "transitions_per_second": calls * steps / spent,
        "megabytes_per_second": size / spent / 1e6,
    }


if __name__ == "__main__":
    serve(Client)
