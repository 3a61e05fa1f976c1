"""The figure of what latency costs: score against the time from a command to its keys."""

import csv
import math
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from actors.robots.latency import AGENT_STEP_MS
from common.errors import InputError
from common.press_latency import ms_of
from learner.figures.plot_style import INK, Series, line_figure


class Played(NamedTuple):
    """Games of a network at one latency of the hand."""

    name: str
    late_ms: float
    """Game time that passes without a new command's keys."""
    mean: float


def read_hand_latency(paths: Sequence[Path]) -> list[Played]:
    """Returns the rows of tables that `benchmarks.lab.hand_latency` writes or once wrote.

    Raises:
        InputError: a file is not such a table.
    """
    return [played for path in paths for played in _read(path)]


def _read(path: Path) -> list[Played]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path} cannot be read: {error}.") from None
    found = []
    for number, row in enumerate(rows, 1):
        try:
            late, mean = ms_of(int(row["press"])), float(row["mean"])
            if not math.isfinite(mean):
                raise ValueError(f"its mean is {mean}")
            found.append(Played(row["network"], late, mean))
        except KeyError:
            break
        except (TypeError, ValueError) as error:
            raise InputError(f"{path} is damaged in row {number}: {error}.") from None
    if not found:
        raise InputError(
            f"{path} is not a table of games at several latencies of the hand: write it with "
            "python -m benchmarks.lab.hand_latency NETWORK … -o FILE.csv."
        )
    return found


def hand_latency_figure(played: Sequence[Played]) -> Figure:
    """Returns the figure, with a line for each network: its mean score by latency."""
    points: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for name, late_ms, mean in played:
        points[name].append((late_ms, mean))
    series = [Series(name, [np.array(sorted(line))]) for name, line in points.items()]
    x, y = "game time without the commanded keys (ms)", "mean score of the evaluation's games"
    figure, axes = line_figure(series, x, y, width=6.5, height=4.2)
    above = axes.secondary_xaxis(
        "top",
        functions=(
            lambda ms: np.asarray(ms) / AGENT_STEP_MS,
            lambda n: np.asarray(n) * AGENT_STEP_MS,
        ),
    )
    above.set_xlabel(f"in agent steps of {AGENT_STEP_MS:.1f} ms", color=INK, fontsize=9)
    above.tick_params(colors=INK, labelsize=8)
    above.spines["top"].set_visible(False)
    return figure
