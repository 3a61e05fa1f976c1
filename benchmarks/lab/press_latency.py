"""`python -m benchmarks.lab.press_latency`: time from command to keys, for every pair of actions.

Half of the changes begin after the old keys were held for a while. The other half begin one agent
step after the old command, as in play. Times are whole emulator frames of 16.7 ms.

`python -m benchmarks.figures.plot --figure press FILE` draws the table.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge
from numpy.typing import NDArray

from actors.robots.latency import FRAME_MS, GOAL, Change, Latency, changes
from actors.robots.latency_model.weights import check_one_copy
from benchmarks.report import BenchmarkOptions, Report, Table, main
from common.actions import KEYS_OF_ACTION
from common.checked import FromOne
from common.games import SCREEN_SHAPE
from common.registry import ROBOTS
from common.settings.conditions import CameraConfig, PlayConfig
from common.strict_json import strict

_NAMES = ["".join(key.name[0] for key in keys if key.name) or "·" for keys in KEYS_OF_ACTION]
"""Each action's keys as letters, such as "UR" or "DLF"; a dot for no keys."""


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Measure how soon a robot's hands hold the commanded keys."""

    robot: str = PlayConfig.robot
    """Robot whose hands are measured."""
    repetitions: FromOne = 4
    """Number of times that each of the 306 changes is made from held keys, and again in play."""
    seed: Annotated[int, Ge(0)] = 1
    """Seed of the order of the changes."""


def tables(found: Sequence[Change]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns median and maximum in ms, ``[18, 18]`` each, from an old action (row) to a new one
    (column); NaN where nothing was reached, and on the diagonal."""
    by_pair: defaultdict[tuple[int, int], list[float]] = defaultdict(list)
    for change in found:
        if change.frames is not None:
            by_pair[change.old, change.new].append(change.frames * FRAME_MS)
    median, worst = np.full((2, len(_NAMES), len(_NAMES)), np.nan)
    for pair, each in by_pair.items():
        median[pair], worst[pair] = np.median(each), max(each)
    return median, worst


def table(median: NDArray[np.float64]) -> Table:
    return Table(
        "Command to keys, ms: from (row) to (column), median",
        [
            {"": name}
            | {to: "" if np.isnan(ms) else f"{ms:.0f}" for to, ms in zip(_NAMES, row, strict=True)}
            for name, row in zip(_NAMES, median, strict=True)
        ],
    )


def sentences(latency: Latency, settled: Latency, unsettled: Latency) -> list[str]:
    """Returns the figures of all changes as sentences, and whether the goals are met."""
    kept = (
        latency.p50_ms <= GOAL.p50_ms + 0.1
        and latency.p99_ms <= GOAL.p99_ms + 0.1
        and not latency.unreached
        and latency.stray_share <= GOAL.stray_share
    )
    return [
        *(
            f"{title}: {found.changes} changes, p50 {found.p50_ms:.1f} ms, "
            f"p99 {found.p99_ms:.1f} ms, {found.unreached} not reached, "
            f"{found.stray_share:.1%} over a key of neither"
            for title, found in (
                ("all", latency),
                ("from held keys", settled),
                ("one agent step after the last command", unsettled),
            )
        ),
        f"goals: p50 ≤ {GOAL.p50_ms:.1f} ms, p99 ≤ {GOAL.p99_ms:.1f} ms, all reached, "
        f"strays ≤ {100 * GOAL.stray_share:.0f} %: " + ("kept" if kept else "missed"),
    ]


def measure(options: Options) -> Report:
    play = PlayConfig(robot=options.robot)
    check_one_copy(play)
    robot = ROBOTS.make(options.robot, SCREEN_SHAPE, CameraConfig(), play)
    found = list(changes(robot, options.repetitions, options.seed))
    robot.close()
    latency = Latency.of(found)
    settled = Latency.of([change for change in found if change.settled])
    unsettled = Latency.of([change for change in found if not change.settled])
    median, worst = tables(found)
    content = strict(  # strict JSON: a missing time is null, not NaN
        {
            "robot": options.robot,
            "title": "Command to keys",
            **asdict(latency),
            "frame_ms": FRAME_MS,
            "from_held_keys": asdict(settled),
            "in_play": asdict(unsettled),
            "actions": _NAMES,
            "table_ms": median.tolist(),
            "worst_ms": worst.tolist(),
        }
    )
    return Report([table(median)], content, sentences(latency, settled, unsettled))


if __name__ == "__main__":
    main("lab.press_latency", Options, measure)
