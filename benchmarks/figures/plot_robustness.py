"""The figure of a robustness grid: a heat map of scores, or curves if there is only one optics."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.pyplot import subplots

from benchmarks.lab.robustness import OPTICS
from benchmarks.report import reading
from common.minus import minus_signed
from learner.figures.plot_style import INK, Series, line_figure

_WORST, _BEST = -21.0, 21.0
"""Scores of Pong at the ends of the colour scale; other games have a scale of their own range."""
_LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Shares of red, green and blue in the luminance of a colour, Rec. 709."""


class Grid(NamedTuple):
    """A grid, with the mean score of each cell."""

    name: str
    optics: list[str]
    added_ms: list[float]
    means: dict[tuple[str, float], float]


def read_grid(path: Path) -> Grid:
    """Returns the grid in the JSON of `benchmarks.lab.robustness` at ``path``.

    Raises:
        InputError: the file holds no grid.
    """
    with reading(path, "grid", "lab.robustness POLICY") as found:
        means = {
            (str(cell["optics"]), float(cell["added_ms"])): float(cell["mean"])
            for cell in found["cells"]
        }
        name = f"{found['network']}, ε = {found['epsilon']:g}, sticky {found['sticky']:g}"
        if not means:
            raise ValueError("none of its cells was played")
        # Cells are in the order in which they were played.
        optics = sorted({each for each, _ in means}, key=[*OPTICS].index)
    return Grid(name, optics, sorted({added for _, added in means}), means)


def robustness_figure(grids: Sequence[Grid]) -> Figure:
    """Returns one heat map for each grid, or all of them as curves if each has one optics."""
    if all(len(grid.optics) == 1 for grid in grids):
        x, y = "added actuation latency, ms", "mean score"
        return line_figure([*map(_curve, grids)], x, y, width=5.2, height=3.8)[0]
    figure, axes = subplots(
        1, len(grids), figsize=(1.4 + 5.0 * len(grids), 3.6), layout="constrained", squeeze=False
    )
    scores = [mean for grid in grids for mean in grid.means.values()]
    if min(scores) < _WORST or max(scores) > _BEST:
        low, high = min(scores), max(scores)
    else:
        low, high = _WORST, _BEST
    for place, grid in zip(axes[0], grids, strict=True):
        image = _heat_map(place, grid, low, high)
    figure.colorbar(image, ax=axes[0].tolist(), label="mean score", shrink=0.9)
    return figure


def _heat_map(axes: Axes, grid: Grid, low: float, high: float) -> Any:
    values = np.array(
        [[grid.means.get((o, added), np.nan) for added in grid.added_ms] for o in grid.optics]
    )
    image = axes.imshow(values, cmap="RdYlBu", vmin=low, vmax=high, aspect="auto")
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            light = np.dot(image.to_rgba(value)[:3], _LUMINANCE) > 0.5
            text = minus_signed(f"{value:.1f}")
            axes.text(column, row, text, ha="center", va="center", color=INK if light else "white")
    axes.set_xticks(range(len(grid.added_ms)), [f"{added:.0f}" for added in grid.added_ms])
    axes.set_yticks(range(len(grid.optics)), [OPTICS[each].title for each in grid.optics])
    axes.tick_params(length=0, labelcolor=INK)
    axes.set_title(grid.name, loc="left", fontsize=9, color=INK)
    axes.set_xlabel("added actuation latency, ms", color=INK)
    return image


def _curve(grid: Grid) -> Series:
    points = [(ms, grid.means[grid.optics[0], ms]) for ms in grid.added_ms]
    return Series(grid.name, [np.array(points)])
