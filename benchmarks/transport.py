"""`python -m benchmarks.transport`: chunks in and batches out over Zenoh, separately and together.

A real replay process, real insert clients and the learner's real replay client, each in a process
of its own, meet on loopback. Encoding, decoding, checking, storing and journaling are all included.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Literal

from benchmarks.child import Helper
from benchmarks.hosted_run import NEVER, RUN, HostedRun
from benchmarks.report import BenchmarkOptions, Report, Seconds, main
from common.checked import FromOne
from common.counted import counted
from common.settings.config import LearningConfig, StreamConfig


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Time the messages between actors, replay and a learner in another process."""

    seconds: Seconds = 8.0
    """Length of each measurement, in seconds."""
    senders: FromOne = 1
    """Number of actor processes that send."""
    window: FromOne = StreamConfig().window
    """Maximum number of unacknowledged chunks of each sender."""
    chunk_steps: FromOne = StreamConfig().chunk_steps
    """Agent steps per chunk."""
    capacity: int = 50_000
    """Capacity of the replay, in steps."""
    batch_size: FromOne = LearningConfig().batch_size
    """Transitions per batch."""
    paced: FromOne = 20_000
    """Steps per second of all senders together, in measurements at a fixed pace."""
    sampler: Literal["uniform", "prioritised"] = "prioritised"
    """Sampler of the batches; prioritised batches also get new priorities."""


class Exchange(HostedRun):
    """The replay process and its clients; a context manager that ends them."""

    def __init__(self, options: Options) -> None:
        super().__init__(
            "replay",
            *("--preset", "paper", "--replay.sampler", options.sampler),
            *("--replay.capacity", str(options.capacity), "--replay.learning-starts", "1024"),
            *("--replay.ratio-tolerance", str(NEVER), "--actor-quota", str(NEVER)),
            *("--stream.chunk-steps", str(options.chunk_steps)),
            *("--learning.batch-size", str(options.batch_size)),
        )
        self._options = options
        self._clients = 0

    def measure(
        self, roles: Sequence[str], window: int | None = None, pace: float | None = None
    ) -> list[dict[str, Any]]:
        """Lets clients of these roles work at the same time; returns their counts in this order.

        Args:
            pace: steps per second of each sender; None for as many as possible.

        Raises:
            InputError: a process failed and printed why.
        """
        with ExitStack() as stack:
            clients = [
                stack.enter_context(self._client(role, window or self._options.window))
                for role in roles
            ]
            for client, role in zip(clients, roles, strict=True):
                client.ask("prepare", role)
            for client, role in zip(clients, roles, strict=True):
                given = (pace,) if role == "send" else ()
                client.begin(role, self._options.seconds, *given)
            return [client.hear() for client in clients]

    def _client(self, role: str, window: int) -> Helper:
        self._clients += 1  # gives each client a name of its own: sequence numbers start at 0
        return Helper(
            f"the measurement ({role})",
            "benchmarks.transport_client",
            connect_to=self.endpoint,
            run=RUN,
            name=f"sender-{self._clients}",
            window=window,
        )


def together(found: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Returns the figures of several processes as one: rates and counts summed, worst latencies."""
    worst = {name: max(each[name] for each in found) for name in ("seconds", "p50_ms", "p99_ms")}
    return {name: sum(each[name] for each in found) for name in found[0]} | worst


def row(work: str, found: dict[str, Any]) -> dict[str, Any]:
    return {
        "work": work,
        "per second": found["calls_per_second"],
        "MB/s": found["megabytes_per_second"],
        "transitions/s": round(found["transitions_per_second"]),
        "p50 ms": found["p50_ms"],
        "p99 ms": found["p99_ms"],
    }


def measure(options: Options) -> Report:
    senders = ["send"] * options.senders
    with Exchange(options) as exchange:
        single = exchange.measure(["send"], window=1)[0]
        insert = together(exchange.measure(senders))
        sample = exchange.measure(["draw"])[0]
        *sent, sample_at_once = exchange.measure([*senders, "draw"])
        pace = options.paced / options.senders
        *sent_paced, sample_beside = exchange.measure([*senders, "draw"], pace=pace)
    found = {
        "insert_one_at_a_time": ("chunks, one at a time", single),
        "insert": (f"chunks, {options.window} under way", insert),
        "sample": ("batches", sample),
        "insert_at_once": ("at once: chunks", together(sent)),
        "sample_at_once": ("at once: batches", sample_at_once),
        "insert_paced": (f"paced, {options.paced:,} steps/s: chunks", together(sent_paced)),
        "sample_beside_paced": ("beside these: batches", sample_beside),
    }
    told = ("chunk_steps", "batch_size", "senders", "window", "sampler", "paced")
    return Report.of(
        f"Zenoh on loopback: chunks of {options.chunk_steps} steps from "
        f"{counted(options.senders, 'sender')}, {options.sampler} batches of "
        f"{options.batch_size}",
        [row(*each) for each in found.values()],
        {name: getattr(options, name) for name in told}
        | {name: figures for name, (_, figures) in found.items()},
    )


if __name__ == "__main__":
    main("transport", Options, measure)
