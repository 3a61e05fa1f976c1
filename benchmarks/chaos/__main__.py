"""`python -m benchmarks.chaos`: breaks a run at random for a while, and audits what is left of it.

A replay, a learner, some actors and an evaluator train on one machine. Each is a process with a
certificate, behind a link of its own, and the run has a disk of its own. One fault after the other
strikes (`storm`). After each fault, the recovery time is measured: until every actor's next chunk
is stored, new weights come and a test is over. At the end all processes are asked to leave. The
replay's files are compared with what the actors recorded, and the learner's table with the tests
that were asked for (`audit`).
"""

import math
import re
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from annotated_types import Gt

from benchmarks.chaos.audit import Audit, AuditOfTests, audit, audit_tests
from benchmarks.chaos.cluster import HUB, LEARNER, Cluster
from benchmarks.chaos.faults import PATIENCE
from benchmarks.chaos.storm import Storm
from benchmarks.child import scratch
from benchmarks.report import BenchmarkOptions, Report, Seconds, Table, main
from common.checked import Count, FromOne
from common.errors import InputError

_ROOM = 0.9
"""Share of the capacity that may be filled: the audit needs everything that was ever stored."""
FLAGS = (
    *("--env", "ale", "--preset", "fast", "--learning.network", "nips"),
    # One update for each step in small chunks: few steps come, so that long runs can be audited.
    *("--learning.batch-size", "32", "--learning.train-period", "1"),
    *("--stream.chunk-steps", "8"),
    *("--replay.learning-starts", "300", "--replay.ratio-tolerance", "2048"),
    *("--learning.publish-period", "10", "--learning.checkpoint-period", "100"),
    *("--protocol.held-out-states", "64"),
    # Tests are short, because each fault waits for one, and a whole game of Pong has a thousand
    # steps. A test has two games or more, so that a fault may strike between two reports.
    *("--protocol.epoch-steps", "48", "--protocol.test-steps", "60"),
    *("--play.max-game-frames", "200"),
)


@dataclass(frozen=True, kw_only=True)
class Options(BenchmarkOptions):
    """Break a run at random, and count what it lost."""

    minutes: Annotated[float, Gt(0)] = 1.0
    """Duration of the faults, in minutes."""
    faults: Count = 0
    """Maximum number of faults; 0 for as many as there is time for."""
    seed: Count = 1
    """Seed of the faults: what breaks, when and for how long."""
    actors: FromOne = 2
    """Number of actors."""
    capacity: FromOne = 100_000
    """Capacity of the replay, in steps; the faults end when it is nearly full."""
    longest: Seconds = 12.0
    """Maximum duration of a fault, in seconds."""
    plain: bool = False
    """Run without certificates, so that TLS does not notice wrong bits; then none can expire."""
    folder: Path | None = None
    """Folder that keeps the run, logs and records; by default a temporary one."""


def measure(options: Options) -> Report:
    if options.folder is not None:
        options.folder.mkdir(parents=True, exist_ok=True)
        if any(options.folder.iterdir()):
            raise InputError(f"{options.folder} is not empty: name another --folder.")
        return _measure(options, options.folder.resolve())
    with scratch() as folder:
        return _measure(options, folder)


def _measure(options: Options, folder: Path) -> Report:
    flags = (*FLAGS, "--seed", str(options.seed))
    with Cluster(
        *(folder, flags, options.actors), capacity=options.capacity, plain=options.plain
    ) as cluster:
        storm = Storm(cluster, options.seed, options.longest)
        if cluster.recovery(PATIENCE) is None:
            raise InputError(f"the run did not begin in {PATIENCE:.0f} s.")
        deadline = time.monotonic() + 60 * options.minutes
        most = options.faults or math.inf
        while (
            time.monotonic() < deadline
            and len(storm.struck) < most
            and cluster.stored_steps < _ROOM * options.capacity
        ):
            storm.strike()
        cluster.conclude()
        found = audit(cluster.run.replay, cluster.records)
        tests = audit_tests(cluster.run.epochs, cluster.config.protocol.test_steps)
        counted = _counted(cluster.log(HUB))
    report = _report(options, storm, found, tests, cluster)
    wrong = [f"a process ended: {each}" for each in storm.unforeseen]
    if not found.clean:
        wrong.append(f"the audit found losses: {found}")
    if not tests.clean:
        wrong.append(f"the audit found tests that nobody asked for, or parts of tests: {tests}")
    if counted != (found.steps, found.stored):
        wrong.append(f"the replay counted {counted} steps and chunks, the audit found {found}")
    if cluster.steps_back >= cluster.starts[LEARNER]:
        wrong.append(f"weights went back {cluster.steps_back} times without a learner's restart")
    if wrong:
        report.publish(options.json)
        raise InputError(f"{'; '.join(wrong)}.")
    return report


def _counted(log: Path) -> tuple[int, int]:
    """Returns the steps and chunks that the replay reported at its end."""
    told = log.read_text()
    reports = re.findall(r"^([\d,]+) steps, .* chunks: ([\d,]+) accepted", told, re.MULTILINE)
    # A replay that ends in peace says last how to go on with it.
    if not reports or "go on with" not in told.rpartition(" accepted")[2]:
        raise InputError(f"the replay ended with: {told.strip().splitlines()[-1]}.")
    steps, chunks = (int(each.replace(",", "")) for each in reports[-1])
    return steps, chunks


def _report(
    options: Options, storm: Storm, found: Audit, tests: AuditOfTests, cluster: Cluster
) -> Report:
    struck = storm.struck
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
        "tests": asdict(tests),
        "certificates": cluster.no_certificates is None,
        "missing": storm.missing,
        "weights_back": cluster.steps_back,
        "starts": cluster.starts,
        "struck": struck,
        "rows": rows,
    }
    halves = struck[: (len(struck) + 1) // 2], struck[len(struck) // 2 :]
    growth = "; ".join(
        f"{name} {_most(halves[0], what, name):.0f}, then {_most(halves[1], what, name):.0f} {unit}"
        for what, unit in (("private_mib", "MiB private"), ("open_files", "open files"))
        for name in (HUB, LEARNER)
    )
    return Report(
        [Table(f"{len(struck)} faults, seed {options.seed}", rows)],
        content,
        (
            f"Audit: {found.made:,} chunks made, {found.acknowledged:,} acknowledged, "
            f"{found.stored:,} stored; {found.lost} lost or altered, {found.duplicated} "
            f"duplicated; {found.steps:,} steps, and {found.unknown_rows} that nobody made.",
            f"Tests: of {tests.tested} epochs, {tests.repeated} repeated, {tests.short} too short.",
            f"Weights went back {cluster.steps_back} times, the learner was started again "
            f"{cluster.starts[LEARNER] - 1} times.",
            f"Most in the first and in the second half of the faults: {growth}.",
            *(f"Not struck: {name}, for {why}." for name, why in storm.missing.items()),
        ),
    )


def _most(struck: Sequence[dict[str, Any]], what: str, name: str) -> float:
    return max((float(each[what][name]) for each in struck), default=math.nan)


if __name__ == "__main__":
    main("chaos", Options, measure)
