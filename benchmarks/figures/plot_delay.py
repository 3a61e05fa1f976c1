"""The figure of what lateness costs: score against the time from a command to its keys."""

import csv
import math
import shlex
from collections import defaultdict
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from benchmarks.lab.ladder import FLAGS
from benchmarks.lab.policy import present_names
from common.errors import InputError
from common.press_latency import ms_of
from learner.figures.plot_style import Series, draw_random, draw_series, label, legend, panels

_FRAME_MS = ms_of(1)
_AGENT_STEP_FRAMES = 4
_PLAYED = {"network", "press", "mean"}
_CLIMBED = {"rung", "game", "seed", "flags", "agent_steps", "random_reward", "mean"}
"""Columns that a table needs; whatever others it has, it may be of a former commit."""
_RUNGS = ("R1", "R2")
"""The emulator with keys at once, and with late ones."""


class Climb(NamedTuple):
    """Games under late keys, by a network that was trained so (the ladder's), or just plays so."""

    name: str
    """Of the series it belongs to: all of a run but delay and seed, or the network that plays."""
    seed: int
    late_ms: float
    """Game time that passes without a new command's keys."""
    mean: float
    random: float | None


def read_ladders(paths: Sequence[Path]) -> list[Climb]:
    """The climbs of rungs R1 and R2 in these tables, and what `benchmarks.lab.actuation_latency`
    found; of the same run evaluated twice, the last.

    Raises:
        InputError: a table is neither's, or there is no such row.
    """
    found: dict[tuple[str, int, float], Climb] = {}
    for path in paths:
        for climb in _read(path):
            found[climb.name, climb.seed, climb.late_ms] = climb
    if not found:
        raise InputError(
            f"{paths[0]} has no row of R1 or R2: climb them first, as in "
            "python -m benchmarks.lab.ladder --rung R2 --delay 2."
        )
    return list(found.values())


def _read(path: Path) -> list[Climb]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            rows = list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path} cannot be read: {error}.") from None
    columns = set(reader.fieldnames or ())
    played = columns >= _PLAYED
    if not played and not columns >= _CLIMBED:
        raise InputError(
            f"{path} is no table of python -m benchmarks.lab.ladder or "
            "benchmarks.lab.actuation_latency: name one of these."
        )
    climbs = []
    for number, row in enumerate(rows, 1):
        try:
            if played:
                climbs.append(_played(row))
            elif row["rung"] in _RUNGS:
                climbs.append(_climb(row))
        except (TypeError, ValueError) as error:
            raise InputError(f"{path} is damaged in row {number}: {error}.") from None
    return climbs


def _climb(row: dict[str, str]) -> Climb:
    flags = present_names(shlex.split(row["flags"]))
    values = dict(pairwise([*flags, "--"]))  # a switch at the end has no value either
    actuation, press = (
        int(values.get(f"--play.{name}-latency", 0)) for name in ("actuation", "press")
    )
    # What sets a run apart beside delay and seed; the rung's own flags go without saying.
    late = {"--play.actuation-latency", *FLAGS["R2"][2::2]}
    known = {"--seed", "--game", "--env", "--preset", *late}
    more = "".join(
        f", {flag}" + ("" if value.startswith("--") else f" {value}")
        for flag, value in values.items()
        if flag.startswith("--") and flag not in known
    )
    steps = float(f"{float(row['agent_steps']):.2g}")
    name = f"{row['game']}, {values.get('--preset', '')}, {_millions(steps)} steps{more}"
    random = float(row["random_reward"]) if row["random_reward"] else None
    return Climb(name, int(row["seed"]), (actuation + press) * _FRAME_MS, _mean(row), random)


def _played(row: dict[str, str]) -> Climb:
    return Climb(row["network"], 1, int(row["press"]) * _FRAME_MS, _mean(row), None)


def _mean(row: dict[str, str]) -> float:
    mean = float(row["mean"])
    if not math.isfinite(mean):
        raise ValueError(f"its mean is {mean}")
    return mean


def _millions(steps: float) -> str:
    return f"{steps / 1e6:g} M" if steps >= 1e5 else f"{steps:,.0f}"


def delay_figure(climbs: Sequence[Climb]) -> Figure:
    """Mean score of the evaluations by the keys' lateness; a thin line for each seed."""
    points: dict[str, dict[int, list[tuple[float, float]]]] = defaultdict(lambda: defaultdict(list))
    for climb in climbs:
        points[climb.name][climb.seed].append((climb.late_ms, climb.mean))
    series = [
        Series(name, [np.array(sorted(line), np.float64) for line in seeds.values()])
        for name, seeds in points.items()
    ]
    figure, (axes,) = panels(1, width=6.5, height=4.2)
    draw_series(axes, series)
    draw_random(axes, [climb.random for climb in climbs if climb.random is not None])
    label(axes, "game time without the commanded keys (ms)", "mean score of the evaluation's games")
    agent_step = _AGENT_STEP_FRAMES * _FRAME_MS
    above = axes.secondary_xaxis(
        "top",
        functions=(lambda ms: np.asarray(ms) / agent_step, lambda n: np.asarray(n) * agent_step),
    )
    above.set_xlabel("in agent steps of 66.7 ms", color="#333333", fontsize=9)
    above.tick_params(colors="#333333", labelsize=8)
    above.spines["top"].set_visible(False)
    legend(figure, axes)
    return figure
