"""`python -m benchmarks.many_actors`: what load a hub carries, from one actor to a thousand.

A real replay process is the hub. Each actor has a real session of its own and sends chunks at the
pace of a robot in real time, one agent step each 66.7 ms. Then weights are broadcast to all. With
``--router`` a second router stands between the hub and all actors, so the hub sends weights once.
"""

import time
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.child import Helper, cpu_seconds, free_endpoint, stat_of
from benchmarks.hosted_run import NEVER, RUN, HostedRun
from benchmarks.report import BenchmarkOptions, Numbers, Report, Seconds, main
from benchmarks.second_router import second_router
from common.checked import FromOne
from common.process.footprint import footprint
from common.settings.conditions import DEFAULT_PLAY

STEPS_PER_SECOND = round(DEFAULT_PLAY.steps_per_second)
"""Agent steps per second of a robot in real time."""
WEIGHTS_BYTES = 6_700_000
"""Size of the weights of the network of Mnih et al. 2015."""


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Send to one replay from more and more actors in real time."""

    numbers: Numbers = (1, 16, 64, 256, 1024)
    """Numbers of actors; each is measured."""
    seconds: Seconds = 20.0
    """Length of each measurement, in seconds."""
    chunk_steps: FromOne = 64
    """Agent steps per chunk."""
    capacity: FromOne = 50_000
    """Capacity of the replay, in steps."""
    router: bool = False
    """Let the actors join a second router, which joins the hub."""


def measure_number(options: Options, actors: int) -> dict[str, Any]:
    """Returns the figures of ``actors`` actors and of the hub.

    Raises:
        InputError: a process failed and printed why.
    """
    with ExitStack() as stack:
        hub = stack.enter_context(
            HostedRun(
                "replay",
                *("--preset", "paper", "--replay.capacity", str(options.capacity)),
                *("--replay.learning-starts", "64", "--replay.ratio-tolerance", str(NEVER)),
                *("--stream.chunk-steps", str(options.chunk_steps)),
            )
        )
        weights = hub.transport.publisher(hub.keys.weights)  # declared before any subscriber joins
        place, carriers = hub.endpoint, [hub.process]
        if options.router:
            place = free_endpoint()
            carriers.append(stack.enter_context(second_router(place, hub.endpoint)))
        pid = hub.process.pid
        alone = footprint(pid).private
        crowd = stack.enter_context(
            Helper(
                "the actors",
                "benchmarks.many_actors_client",
                actors=actors,
                connect_to=place,
                run=RUN,
            )
        )
        join_seconds = crowd.ask("join_seconds")
        joined, began = footprint(pid).private, time.monotonic()
        before = [cpu_seconds(stat_of(each.pid)) for each in carriers]
        told = crowd.ask("play", options.seconds, STEPS_PER_SECOND)
        after = [cpu_seconds(stat_of(each.pid)) for each in carriers]
        private = footprint(pid).private
        seconds = time.monotonic() - began
        latencies = told.pop("latencies")
        published = time.monotonic()
        weights.publish(bytes(WEIGHTS_BYTES))
        arrivals = crowd.ask("arrivals")
        hub.check()
    p50, p99 = np.percentile(latencies, (50, 99)).tolist()
    hub_cores, *router_cores = ((np.array(after) - before) / seconds).tolist()
    return {
        "actors": actors,
        "join_seconds": join_seconds,
        **told,
        "seconds": seconds,
        "steps_per_second": told["acknowledged"] * options.chunk_steps / seconds,
        "p50_ms": p50 * 1e3,
        "p99_ms": p99 * 1e3,
        "hub_cores": hub_cores,
        "router_cores": router_cores,
        "hub_bytes": private,
        "hub_bytes_per_actor": (joined - alone) / actors,
        "weights_arrived": len(arrivals),
        "weights_seconds": arrivals[-1] - published if arrivals else None,
    }


def row(found: dict[str, Any]) -> dict[str, Any]:
    routers = ("router",) * len(found["router_cores"])
    return {
        "actors": found["actors"],
        "steps/s": found["steps_per_second"],
        "p50 ms": found["p50_ms"],
        "p99 ms": found["p99_ms"],
        "late": found["held_back"],
        "cores": found["hub_cores"],
        **dict(zip(routers, found["router_cores"], strict=True)),
        "KB each": found["hub_bytes_per_actor"] / 1e3,
        "join s": found["join_seconds"],
        "reached": found["weights_arrived"],
        "in s": found["weights_seconds"],
    }


def measure(options: Options) -> Report:
    found = []
    for actors in options.numbers:
        found.append(measure_number(options, actors))
        print(f"{actors}: {found[-1]['steps_per_second']:.0f} steps/s", flush=True)
    return Report.of(
        f"Actors in real time at one hub, each {STEPS_PER_SECOND} steps/s in chunks of "
        f"{options.chunk_steps}; late: chunks held back; cores and KB each: the hub's; "
        f"{'router: its cores; ' if options.router else ''}"
        f"reached: by weights of {WEIGHTS_BYTES / 1e6:.1f} MB",
        [row(each) for each in found],
        {"many_actors": found},
    )


if __name__ == "__main__":
    main("many_actors", Options, measure)
