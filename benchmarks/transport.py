"""`python -m benchmarks.transport`: chunks in and batches out over Zenoh, alone and at once.

A real replay process, real outboxes and the learner's real client, each in a process of its own,
meet on loopback. Encoding, decoding, checking, storing and journaling are all in it.
"""

import contextlib
import json
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self

import tyro

from benchmarks.child import end_as_by_ctrl_c, free_endpoint
from benchmarks.report import publish
from common.errors import InputError, exit_on_input_error
from common.process.supervisor import Child
from common.run.config import StreamConfig

_RUN = "bench"


@dataclass(frozen=True)
class Options:
    """Time the way between actors, replay and a learner elsewhere."""

    seconds: float = 5.0
    """Of each figure."""
    senders: int = 1
    """Actor processes that send."""
    window: int = StreamConfig().window
    """Chunks that each of them may have unacknowledged."""
    chunk_steps: int = StreamConfig().chunk_steps
    """Steps of a chunk."""
    capacity: int = 50_000
    """Steps in the replay."""
    sampler: Literal["uniform", "prioritised"] = "prioritised"
    """How batches are drawn; prioritised ones are also given new priorities, by an RPC more."""
    json: Path | None = None
    """File for the results."""

    def check(self) -> None:
        if min(self.senders, self.window, self.chunk_steps) < 1 or not self.seconds > 0:
            raise InputError("choose 1 or more senders, chunks and steps, and seconds above 0.")


class Exchange:
    """The replay process, and those that talk to it; a context manager that ends them."""

    def __init__(self, options: Options, folder: Path) -> None:
        self._options = options
        self._folder = folder
        self._endpoint = free_endpoint()
        self._spoken = 0

    def __enter__(self) -> Self:
        options = self._options
        self._server = Child(
            "replay",
            *("--run", _RUN, "--runs", str(self._folder), "--listen", self._endpoint),
            *("--preset", "paper", "--replay.sampler", options.sampler),
            *("--replay.capacity", str(options.capacity), "--replay.learning-starts", "64"),
            *("--replay.ratio-tolerance", str(10**9)),
            *("--stream.chunk-steps", str(options.chunk_steps)),
            stdout=subprocess.DEVNULL,
        )
        return self

    def __exit__(self, *_: object) -> None:
        self._server.end()

    def measure(self, roles: Sequence[str], window: int | None = None) -> list[dict[str, Any]]:
        """What processes of these roles count while all work at once; in the same order.

        Raises:
            InputError: one of them failed, and has said why.
        """
        clients = [self._client(role, window or self._options.window) for role in roles]
        try:
            for client in clients:
                if self._hear(client) != "ready":
                    raise InputError("a process of the measurement failed, see above.")
            for client in clients:
                assert client.stdin is not None
                with contextlib.suppress(BrokenPipeError):
                    client.stdin.write("go\n")
                    client.stdin.flush()
            answers = [self._hear(client) for client in clients]
            if not all(answers):
                raise InputError("a process of the measurement failed, see above.")
            return [json.loads(answer) for answer in answers]
        finally:
            for client in clients:
                client.end()

    def _client(self, role: str, window: int) -> Child:
        self._spoken += 1  # a name of its own, for sequence numbers begin anew
        return Child(
            "benchmarks.transport_client",
            *("--role", role, "--connect", self._endpoint, "--run", _RUN),
            *("--seconds", str(self._options.seconds), "--window", str(window)),
            *("--name", f"sender-{self._spoken}"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )

    def _hear(self, client: Child) -> str:
        assert client.stdout is not None
        return client.stdout.readline().strip()


def together(found: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Several processes' figures as one: rates summed, of latencies the worst, counts summed."""
    worst = {name: max(each[name] for each in found) for name in ("seconds", "p50_ms", "p99_ms")}
    return {name: sum(each[name] for each in found) for name in found[0]} | worst


def row(work: str, found: dict[str, Any]) -> dict[str, Any]:
    """One measurement as a line of the table."""
    return {
        "work": work,
        "per second": found["calls_per_second"],
        "MB/s": found["megabytes_per_second"],
        "transitions/s": round(found["transitions_per_second"]),
        "p50 ms": found["p50_ms"],
        "p99 ms": found["p99_ms"],
    }


def main() -> None:
    options = tyro.cli(Options, prog="python -m benchmarks.transport")
    options.check()
    end_as_by_ctrl_c()
    senders = ["send"] * options.senders
    with (
        tempfile.TemporaryDirectory(prefix="ale-robot-bench-") as folder,
        Exchange(options, Path(folder)) as exchange,
    ):
        single = exchange.measure(["send"], window=1)[0]
        insert = together(exchange.measure(senders))
        sample = exchange.measure(["draw"])[0]
        *sent, sample_at_once = exchange.measure([*senders, "draw"])
    insert_at_once = together(sent)
    publish(
        f"Zenoh on loopback: chunks of {options.chunk_steps} steps from {options.senders} "
        f"sender{'s' if options.senders > 1 else ''}, {options.sampler} batches of 32",
        [
            row("chunks, one at a time", single),
            row(f"chunks, {options.window} under way", insert),
            row("batches", sample),
            row("at once: chunks", insert_at_once),
            row("at once: batches", sample_at_once),
        ],
        options.json,
        {
            "chunk_steps": options.chunk_steps,
            "batch_size": 32,
            "senders": options.senders,
            "window": options.window,
            "sampler": options.sampler,
            "insert_one_at_a_time": single,
            "insert": insert,
            "sample": sample,
            "insert_at_once": insert_at_once,
            "sample_at_once": sample_at_once,
        },
    )


if __name__ == "__main__":
    exit_on_input_error(main)
