"""`python -m benchmarks.chaos.curves`: whether a run with faults learns as well as one without.

For each seed Catch is trained twice, once with the faults of `python -m benchmarks.chaos` and once
without. Two figures of each curve are compared in pairs: the mean score of the last epochs (what
was learned) and that of all epochs (how fast). The difference has a 95 % interval by Student's t
over the seeds. The curves agree if both intervals lie within a margin around 0. After an
interruption, the same command with --json continues with the next pair.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from benchmarks import catch
from benchmarks.chaos.cluster import Cluster
from benchmarks.chaos.faults import PATIENCE
from benchmarks.chaos.storm import Storm
from benchmarks.child import scratch
from benchmarks.lab.policy import scores_of
from benchmarks.report import BenchmarkOptions, Report, Seconds, main, resumed, write
from common.checked import FromOne
from common.errors import InputError
from common.run.epochs import EpochTable

_LAST = 3
"""Number of epochs at the end of a curve whose mean score counts as what was learned."""
_T = (12.71, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262)
"""97.5 % quantiles of Student's t with 1, 2, 3 … degrees of freedom."""
FLAGS = (
    *("--env", "catch", "--preset", "fast", "--learning.network", "nips"),
    *("--learning.batch-size", "32", "--learning.train-period", "4", "--stream.chunk-steps", "16"),
    *("--learning.learning-rate", "0.0005", "--learning.n-step", "1", "--learning.discount", "0.9"),
    *("--learning.target-update-period", "100", "--learning.publish-period", "20"),
    *("--learning.checkpoint-period", "100", "--exploration.end", "0.1"),
    *("--exploration.steps", "3000", "--replay.learning-starts", "1000"),
    *("--replay.ratio-tolerance", "256", "--protocol.epoch-steps", "1000"),
    *("--protocol.held-out-states", "64"),
)


@dataclass(frozen=True, kw_only=True)
class Options(BenchmarkOptions):
    """Train the same seeds with and without faults, and compare the scores."""

    seeds: Annotated[int, Ge(2), Le(10)] = 3
    """Number of pairs of runs; their seeds are 1, 2, 3 …"""
    steps: FromOne = 10_000
    """Length of each run, in agent steps."""
    actors: FromOne = 2
    """Number of actors."""
    longest: Seconds = 2.0
    """Maximum duration of a fault, in seconds."""
    margin: Annotated[float, Gt(0)] = 0.2
    """Largest difference of mean scores, which are −1 to 1, that counts as none."""


def measure(options: Options) -> Report:
    about = {
        **{"title": "learning curves of Catch with and without faults", "steps": options.steps},
        **{"actors": options.actors, "longest": options.longest, "margin": options.margin},
    }
    curves = resumed(options.json, about, "curves of these settings").get("curves", [])
    for seed in range(len(curves) + 1, options.seeds + 1):
        without, _ = _run(options, seed, faults=False)
        broken, faults = _run(options, seed, faults=True)
        curves.append({"seed": seed, "faults": faults, "without": without, "with": broken})
        write(options.json, {**about, "curves": curves})
    rows = [
        {
            **{"seed": each["seed"], "faults": each["faults"]},
            **{
                f"{part}, {how}": float(np.mean(each[how][begin:]))
                for part, begin in (("last", -_LAST), ("all", 0))
                for how in ("without", "with")
            },
        }
        for each in curves
    ]
    notes, differences, agree = [], {}, True
    for name in ("last", "all"):
        found = [row[f"{name}, with"] - row[f"{name}, without"] for row in rows]
        mean, half = interval(found)
        within = abs(mean) + half <= options.margin
        agree &= within
        differences[name] = {"mean": mean, "half_width": half, "within_margin": within}
        notes.append(
            f"Mean score of {name} epochs, with faults less without: {mean:+.3f} ± {half:.3f}, "
            f"{'within' if within else 'not within'} ±{options.margin:g}."
        )
    notes.append(f"The curves {'agree' if agree else 'are not shown to agree'}.")
    summary = {**about, "differences": differences, "agree": agree, "curves": curves}
    return Report.of(str(about["title"]), rows, summary, *notes)


def interval(values: Sequence[float]) -> tuple[float, float]:
    """Returns the mean of 2 to 10 values, and half the width of its 95 % interval."""
    deviation = float(np.std(values, ddof=1))
    return float(np.mean(values)), _T[len(values) - 2] * deviation / len(values) ** 0.5


def _run(options: Options, seed: int, *, faults: bool) -> tuple[list[float], int]:
    """Returns the mean score of each training epoch, and the number of faults."""
    flags = (*FLAGS, "--seed", str(seed))
    with (
        scratch() as folder,
        catch.installed(folder),
        Cluster(
            *(folder, flags, options.actors),
            capacity=4 * options.steps,
            goal=options.steps,
            evaluator=False,  # training games are compared
        ) as cluster,
    ):
        storm = Storm(cluster, seed, options.longest)
        while not cluster.finished:
            if faults:
                storm.strike()
            elif cluster.recovery(PATIENCE) is None:
                raise InputError(f"the run of seed {seed} makes no progress.")
        cluster.conclude()
        if storm.unforeseen:
            raise InputError(f"a process ended: {'; '.join(storm.unforeseen)}.")
        scores = scores_of(EpochTable(cluster.run.epochs).rows())
        return [mean for _, mean in scores], len(storm.struck)


if __name__ == "__main__":
    main("chaos.curves", Options, measure)
