"""`python -m benchmarks.lab.press_latency`: from a command to its keys, for every pair of actions.

Half of the changes begin after the old keys were held for a while, half one agent step after the
old command, as in play. Times are whole emulator frames of 16.7 ms.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from annotated_types import Ge

from actors.robots.latency import (
    AGENT_STEP_MS,
    FRAME_MS,
    MOST_STRAYS,
    Latency,
    changes,
    short_name,
)
from benchmarks.figures.plot_press import press_figure
from benchmarks.report import BenchmarkOptions, Report, Table, main
from common.checked import FromOne
from common.registry import ROBOTS
from common.run.conditions import CameraConfig, PlayConfig
from learner.figures.plot_style import check_picture, save

_SCREEN = (210, 160)
"""Rows and columns of most games."""
_NAMES = [short_name(action) for action in range(18)]


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Measure how promptly a robot's hands obey."""

    robot: str = PlayConfig.robot
    """Robot whose hands are measured."""
    repetitions: FromOne = 4
    """Times that each of the 306 changes is made from held keys, and again in play."""
    seed: Annotated[int, Ge(0)] = 1
    """Seed of the order of the changes."""
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Picture of the table: .png, .svg or .pdf."""

    def check(self) -> None:
        super().check()
        if self.output is not None:
            check_picture(self.output)


def _or_null(ms: float) -> float | None:
    return None if np.isnan(ms) else ms


def content(latency: Latency, settled: Latency, unsettled: Latency) -> dict[str, Any]:
    """The measurement as JSON; a time that does not exist is null."""

    def figures(found: Latency) -> dict[str, Any]:
        return {
            "changes": found.count,
            "p50_ms": _or_null(found.p50_ms),
            "p99_ms": _or_null(found.p99_ms),
            "unreached": found.unreached,
            "stray_share": found.stray_share,
        }

    def rows(table: Any) -> list[list[float | None]]:
        return [[_or_null(ms) for ms in row] for row in table.tolist()]

    return {
        "title": "Command to keys",
        **figures(latency),
        "frame_ms": FRAME_MS,
        "from_held_keys": figures(settled),
        "in_play": figures(unsettled),
        "actions": _NAMES,
        "table_ms": rows(latency.table_ms),
        "worst_ms": rows(latency.worst_ms),
    }


def table(latency: Latency) -> Table:
    return Table(
        "Command to keys, ms: from (row) to (column), median",
        [
            {"": name}
            | {to: "" if np.isnan(ms) else f"{ms:.0f}" for to, ms in zip(_NAMES, row, strict=True)}
            for name, row in zip(_NAMES, latency.table_ms, strict=True)
        ],
    )


def sentences(latency: Latency, settled: Latency, unsettled: Latency) -> list[str]:
    """What all changes came to, and whether the goals are kept."""
    kept = (
        latency.p50_ms <= AGENT_STEP_MS + 0.1
        and latency.p99_ms <= 2 * AGENT_STEP_MS + 0.1
        and not latency.unreached
        and latency.stray_share <= MOST_STRAYS
    )
    return [
        *(
            f"{title}: {found.count} changes, p50 {found.p50_ms:.1f} ms, p99 {found.p99_ms:.1f} ms,"
            f" {found.unreached} not reached, {found.stray_share:.1%} over a key of neither"
            for title, found in (
                ("all", latency),
                ("from held keys", settled),
                ("one agent step after the last command", unsettled),
            )
        ),
        "goals: p50 ≤ 66.7 ms, p99 ≤ 133.3 ms, all reached, strays ≤ 5 %: "
        + ("kept" if kept else "missed"),
    ]


def measure(options: Options) -> Report:
    play = PlayConfig(robot=options.robot)
    robot = ROBOTS.make(options.robot, _SCREEN, CameraConfig(), play)
    found = list(changes(robot, options.repetitions, options.seed))
    robot.close()
    parts = (
        Latency.of(found),
        Latency.of([change for change in found if change.settled]),
        Latency.of([change for change in found if not change.settled]),
    )
    named = {"robot": options.robot, **content(*parts)}
    if options.output is not None:
        save(press_figure(named), options.output)
    return Report([table(parts[0])], named, sentences(*parts))


if __name__ == "__main__":
    main("lab.press_latency", Options, measure)
