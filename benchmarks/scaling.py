"""`python -m benchmarks.scaling`: how speed grows with the number of actors on this machine.

Each number of actors is measured as in `benchmarks.epochs_per_day`. `python -m
benchmarks.figures.plot --figure scaling` draws the results.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from benchmarks.epochs_per_day import paces_of, summary
from benchmarks.local_run import Setting
from benchmarks.report import Numbers, Report, Seconds, main


@dataclass(frozen=True)
class Options(Setting):
    """Measure local mode with several numbers of actors."""

    numbers: Numbers = (1, 2, 4, 8)
    """Numbers of actors; each is measured, and --actors is ignored."""
    seconds: Seconds = 10.0
    """Length of each of the three windows for each number, in seconds."""


def row(found: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "actors": found["actors"],
        "train/s": found["train_steps_per_second"],
        "at test": found["train_steps_per_second_beside_test"],
        "test/s": found["test_steps_per_second_beside_training"],
        "samples": found["samples_per_insert"],
        "stale": found["staleness_updates"]["p50"],
        **({} if found["sync"] else {"in time": found["deadlines_kept"]}),
        "epochs": found["epochs_per_day"],
        "beside": found["epochs_per_day_overlapped"],
    }


def measure(options: Options) -> Report:
    measured = []
    for actors in options.numbers:
        setting = dataclasses.replace(options, actors=actors)
        measured.append(summary(setting, paces_of(setting, options.seconds)))
        print(f"{actors}: {measured[-1]['train_steps_per_second']:.1f} steps/s", flush=True)
    return Report.of(
        f"Local mode, {options} (samples per insert; "
        "staleness in updates, p50; epochs a day with tests after training, and beside it)",
        [row(each) for each in measured],
        {"scaling": measured},
    )


if __name__ == "__main__":
    main("scaling", Options, measure)
