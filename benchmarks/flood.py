"""`python -m benchmarks.flood`: how much one client with a certificate can slow a training.

A learner, which is its own hub, and one actor train Catch with certificates. There are three kinds
of turns:

* learner and actor run alone;
* another client with a certificate of its own floods them with valid chunks as fast as it can, with
  heartbeats and with requests for the newest weights;
* a busy process runs beside them and sends nothing.

Each turn is a run of its own, because a flood's steps stay in the replay. The rate is the learner's
own figure: updates by its clock. All processes share one machine, so the busy process takes as many
cores as the flooder took, and the cost of the flood is given relative to that.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import catch
from benchmarks.child import Helper, scratch
from benchmarks.flood_training import ACTOR, FLOODER, Training, rates
from benchmarks.pace import Spread, in_turns
from benchmarks.report import BenchmarkOptions, Report, Seconds, Table, main
from common.checked import FromOne
from common.transport.flood_guard import CUT_OFF
from common.transport.leaky_bucket import ACTOR_QUOTA
from deploy.certificates import certify_actors

ALONE, FLOODED, BUSY = "alone", "flooded", "beside a busy process"


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Flood a training from a client with a certificate, and measure how much slower it becomes."""

    turns: FromOne = 4
    """Number of runs of each kind."""
    seconds: Seconds = CUT_OFF
    """Length of the measurement in each run, in seconds; by default until the hub hears the flooder
    again."""
    quota: FromOne = ACTOR_QUOTA
    """Steps per second that the hub accepts from one actor (--actor-quota)."""
    settle: Seconds = 10.0
    """Seconds of training, or of training under the flood, before the measurement. A flood first
    fills the room that the limiter leaves."""


def measure_turn(
    options: Options, certificates: Path, *, flooded: bool = False, busy: float = 0.0
) -> dict[str, float]:
    """Returns the rates of one run, per second, and of the flood if there was one.

    Args:
        busy: cores that a process beside it takes.

    Raises:
        InputError: a process failed and printed why.
    """
    with ExitStack() as stack:
        run = stack.enter_context(Training(options.quota, certificates))
        run.await_seconds(options.settle)
        beside = None
        if flooded:
            beside = stack.enter_context(run.flood())
            run.await_flood()
        elif busy:
            beside = Helper("the busy process", "benchmarks.busy", cores=busy)
            stack.enter_context(beside)
        run.await_seconds(options.settle)
        first = run.mark(beside)
        run.await_seconds(options.seconds)
        last = run.mark(beside)
        if flooded and beside is not None:
            beside.ask("stop")
        run.check()
    return rates(first, last)


def measure(options: Options) -> Report:
    with scratch() as folder, catch.installed(folder):
        certificates = folder / "certificates"
        certify_actors(certificates, "localhost", (ACTOR, FLOODER))
        turn = partial(measure_turn, options, certificates)
        floods: list[dict[str, float]] = []

        def flooded() -> dict[str, float]:
            floods.append(turn(flooded=True))
            return floods[-1]

        kinds: dict[str, Callable[[], dict[str, float]]]
        kinds = {ALONE: turn, FLOODED: flooded, BUSY: lambda: turn(busy=floods[-1]["cpu"])}
        return report(in_turns(kinds, options.turns, warm_up=0, tell=True))


def report(found: Mapping[str, Sequence[dict[str, float]]]) -> Report:
    """Returns the report of all turns of each kind; turns of the same number are compared."""
    rows = []
    for kind, turns in found.items():
        updates = Spread.of([each["updates"] for each in turns])
        rows.append(
            {
                "training": kind,
                "updates/s": updates.median,
                "least": updates.least,
                "most": updates.most,
                "of alone": _ratio(turns, found[ALONE]).median,
                "actor's steps/s": _median(turns, "agent_steps"),
                "learner's cores": _median(turns, "learner_cores"),
                "cores beside": _median(turns, "cpu"),
            }
        )
    ratio, refusals = _ratio(found[FLOODED], found[BUSY]), _refusals(found[FLOODED])
    title = (
        f"Training of Catch beside one certified client that floods its hub, {len(found[ALONE])} "
        "turns each"
    )
    return Report(
        [Table(title, rows), Table("What the flood sent, and the hub refused", refusals)],
        {
            **{"title": title, "ratio": ratio._asdict(), "turns": found},
            **{"rows": rows, "refusals": refusals},
        },
        (
            f"Updates/s under the flood, of those beside a process that takes as many cores and "
            f"sends nothing: {ratio.median:.3f} ({ratio.least:.3f} to {ratio.most:.3f}, turn by "
            "turn).",
        ),
    )


def _ratio(turns: Sequence[dict[str, float]], others: Sequence[dict[str, float]]) -> Spread:
    """Returns the updates of ``turns`` as a share of those of ``others``, turn by turn."""
    pairs = zip(turns, others, strict=True)
    return Spread.of([some["updates"] / other["updates"] for some, other in pairs])


def _median(turns: Sequence[dict[str, float]], name: str) -> float:
    return float(np.median([each.get(name, 0.0) for each in turns]))


def _refusals(turns: Sequence[dict[str, float]]) -> list[dict[str, Any]]:
    """Returns a row for each kind of message: how many per second the flooder sent and the hub
    accepted."""
    size = f"{_median(turns, 'chunk bytes') / 1e6:.0f} MB/s"
    rows = []
    for kind, taken, why in (
        ("chunks", "chunks stored", f"{size}; over quota or turn"),
        ("heartbeats", "heartbeats_heard", "too often"),
        ("requests", "requests answered", "too often"),
    ):
        sent, took = _median(turns, kind), _median(turns, taken)
        rows.append(
            {
                **{"message": kind, "sent/s": sent, "taken/s": took},
                "refused": 1 - took / sent if sent else None,
                "why": why,
            }
        )
    return rows


if __name__ == "__main__":
    main("flood", Options, measure)
