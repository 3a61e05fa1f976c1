"""`python -m benchmarks.chaos`: breaks a run at random for a while, and audits what is left of it.

A replay, a learner and some actors train on one machine, each a process behind a link of its own.
One fault after the other strikes a process or a link, as a seed draws them: each kind once, then
each once again. After each, the time is measured until every actor's next chunk is stored and new
weights come. At the end everything is asked to leave, and the replay's files are compared with what
the actors recorded (`audit`).
"""

import math
import random
import time
from collections import Counter, defaultdict
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from annotated_types import Gt

from benchmarks.chaos.audit import Audit, audit
from benchmarks.chaos.cluster import HUB, LEARNER, Cluster
from benchmarks.chaos.faults import FAULTS
from benchmarks.child import scratch
from benchmarks.report import BenchmarkOptions, Report, Table, main
from common.checked import Count, FromOne
from common.errors import InputError

_SHORTEST, _LONGEST = 0.2, 3.0
"""Seconds of work between faults."""
_PATIENCE = 120.0
"""Seconds after which a run counts as one that does not recover."""
_ROOM = 0.9
"""Share of the capacity that may be filled: the audit needs all that was ever stored."""
FLAGS = (
    *("--env", "ale", "--preset", "fast", "--learning.network", "nips"),
    # An update for each step: few steps, so that long runs can be audited, in small chunks.
    *("--learning.batch-size", "32", "--learning.train-period", "1"),
    *("--stream.chunk-steps", "16"),
    *("--replay.learning-starts", "500", "--replay.ratio-tolerance", "2048"),
    *("--learning.publish-period", "20", "--learning.checkpoint-period", "100"),
    *("--protocol.held-out-states", "64", "--protocol.epoch-steps", "1000000"),
)


@dataclass(frozen=True, kw_only=True)
class Options(BenchmarkOptions):
    """Break a run at random, and count what it lost."""

    minutes: Annotated[float, Gt(0)] = 1.0
    """Minutes of faults."""
    faults: Count = 0
    """Number of faults after which it ends sooner; 0 for as many as there is time for."""
    seed: Count = 1
    """Seed of what is broken, when and for how long."""
    actors: FromOne = 2
    """Number of actors."""
    capacity: FromOne = 100_000
    """Steps that the replay can store; when they are nearly full it ends sooner."""
    folder: Path | None = None
    """Folder that keeps run, logs and records; by default a temporary one."""


def measure(options: Options) -> Report:
    if options.folder is not None:
        options.folder.mkdir(parents=True, exist_ok=True)
        if any(options.folder.iterdir()):
            raise InputError(f"{options.folder} holds something already: name another --folder.")
        return _measure(options, options.folder)
    with scratch() as folder:
        return _measure(options, folder)


def _measure(options: Options, folder: Path) -> Report:
    draw = random.Random(options.seed)
    flags = (*FLAGS, "--seed", str(options.seed), "--replay.capacity", str(options.capacity))
    struck: list[dict[str, Any]] = []
    deck: list[str] = []  # each kind once, then each once again
    with Cluster(folder, flags, options.actors) as cluster:
        if cluster.recovery(_PATIENCE) is None:
            raise InputError(f"the run did not begin in {_PATIENCE:.0f} s.")
        memory = {name: cluster.private_mib(name) for name in (HUB, LEARNER)}
        deadline = time.monotonic() + 60 * options.minutes
        most = options.faults or math.inf
        while (
            time.monotonic() < deadline
            and len(struck) < most
            and cluster.stored_steps < _ROOM * options.capacity
        ):
            time.sleep(draw.uniform(_SHORTEST, _LONGEST))
            deck = deck or draw.sample(list(FAULTS), len(FAULTS))
            struck.append(_strike(cluster, deck.pop(), draw))
            last = struck[-1]
            told = f"{last['fault']}, {last['target']}: all work again after"
            print(f"{len(struck):4} {told} {last['recovery']:.1f} s", flush=True)
        after = {name: cluster.private_mib(name) for name in (HUB, LEARNER)}
        starts = dict(cluster.starts)
        cluster.conclude()
        found = audit(cluster.replay, cluster.records)
    report = _report(options, struck, found, starts, memory, after)
    known = [each for row in struck if FAULTS[row["fault"]].may_end for each in row["ended"]]
    unforeseen = [each for each in cluster.ended if each not in known]
    if unforeseen or not found.clean:
        report.publish(options.json)
        raise InputError(
            f"the audit found losses: {found}."
            if not found.clean
            else f"not every process lived on: {'; '.join(unforeseen)}."
        )
    return report


def _strike(cluster: Cluster, name: str, draw: random.Random) -> dict[str, Any]:
    """Let one fault happen, and wait until all work again.

    Raises:
        InputError: the run does not recover.
    """
    fault, before = FAULTS[name], len(cluster.ended)
    target = draw.choice(fault.targets(cluster))
    seconds = draw.uniform(*fault.seconds)
    end = fault.strike(cluster, target, draw)
    if end is not None:
        time.sleep(seconds)
        end()
    recovery = cluster.recovery(_PATIENCE)
    if recovery is None:
        raise InputError(
            f"the run did not recover in {_PATIENCE:.0f} s from: {name}, {target}, {seconds:.1f} s"
            f"{''.join(f'; {each}' for each in cluster.ended)}."
        )
    ended = cluster.ended[before:]
    return {
        **{"fault": name, "target": target, "seconds": seconds, "recovery": recovery},
        "ended": ended,
    }


def _report(
    options: Options,
    struck: list[dict[str, Any]],
    found: Audit,
    starts: dict[str, int],
    before: dict[str, float],
    after: dict[str, float],
) -> Report:
    times: defaultdict[tuple[str, str], list[float]] = defaultdict(list)
    ends: Counter[tuple[str, str]] = Counter()
    for each in struck:
        kind = each["fault"], each["target"].partition("-")[0]
        times[kind].append(each["recovery"])
        ends[kind] += len(each["ended"])
    rows = [
        {
            "fault": fault,
            "target": role,
            "times": len(seconds),
            "recovery p50 s": round(float(np.percentile(seconds, 50)), 1),
            "p95 s": round(float(np.percentile(seconds, 95)), 1),
            "longest s": round(max(seconds), 1),
            "ended by it": ends[fault, role],
        }
        for (fault, role), seconds in sorted(times.items())
    ]
    content = {
        "title": "chaos",
        "minutes": options.minutes,
        "seed": options.seed,
        "actors": options.actors,
        "faults": len(struck),
        "audit": asdict(found),
        "starts": starts,
        "private_mib": {"before": before, "after": after},
        "struck": struck,
        "rows": rows,
    }
    memory = ", ".join(f"{name} {before[name]:.0f} → {after[name]:.0f} MiB" for name in before)
    return Report(
        [Table(f"{len(struck)} faults, seed {options.seed}", rows)],
        content,
        (
            f"Audit: {found.made:,} chunks made, {found.acknowledged:,} acknowledged, "
            f"{found.stored:,} stored; {found.lost} lost or altered, {found.duplicated} "
            f"duplicated; {found.steps:,} steps, and {found.unknown_rows} that nobody made.",
            f"Private memory: {memory}.",
        ),
    )


if __name__ == "__main__":
    main("chaos", Options, measure)
