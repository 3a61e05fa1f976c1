"""The style of all figures: lines that differ in colour, in grey, and for the colour-blind."""

import math
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import NamedTuple, Protocol, Self, TypeVar

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from common.atomic_file import check_new_file, write_atomically
from common.counted import counted
from common.errors import InputError, writing
from common.minus import minus_signed

_SUFFIXES = (".png", ".svg", ".pdf")
RANDOM = "#c1121f"
"""Red, as in the 2017 report."""
INK = "#333333"
_LOOKS = (
    ("#0b3c6f", "-", "o"),
    ("#e08214", "--", "s"),
    ("#1b9e77", "-.", "^"),
    ("#a63d8f", (0, (5, 1, 1, 1, 1, 1)), "D"),
    ("#67a9cf", (0, (1, 1)), "v"),
    ("#7f7f7f", (0, (8, 2)), "P"),
)
_MARKERS = 14
"""Maximum number of markers on a line."""
_THIN, _THICK = 0.8, 1.8
_HANDLE, _LETTER = 0.75, 0.075
"""Inches of a legend's entry: for its line and gaps, and for each letter."""

Points = NDArray[np.float64]
"""Points of a line, ``[n, 2]``: x and y, by rising x."""


class Series(NamedTuple):
    """Lines of the same kind, one for each seed."""

    name: str
    lines: list[Points]


class _Named(Protocol):
    @property
    def name(self) -> str: ...

    def _replace(self, *, name: str) -> Self: ...


N = TypeVar("N", bound=_Named)


def renamed(found: Sequence[N], names: Sequence[str]) -> list[N]:
    """Returns ``found`` with new ``names``, which follow the order of the present names.

    Raises:
        InputError: the number of names is wrong.
    """
    own = list(dict.fromkeys(each.name for each in found))
    if names and len(names) != len(own):
        lines = counted(len(own), "line")
        raise InputError(
            f"--names has {len(names)} names for {lines} ({', '.join(own)}): give one for each."
        )
    new = dict(zip(own, names or own, strict=True))
    return [each._replace(name=new[each.name]) for each in found]


def check_figure(path: Path) -> None:
    """Refuses a path that does not end like a picture, or cannot be written.

    Raises:
        InputError: it names the file.
    """
    if path.suffix.lower() not in _SUFFIXES:
        raise InputError(f"{path} is not a picture's name: let it end in .png, .svg or .pdf.")
    check_new_file(path)


def save(figure: Figure, path: Path) -> None:
    """Writes ``figure`` to ``path``, prints so, and closes the figure.

    Raises:
        InputError: the file cannot be written.
    """
    try:
        content = BytesIO()
        figure.savefig(content, format=path.suffix[1:], dpi=150)
        with writing(path):
            write_atomically(path, content.getvalue())
    finally:
        plt.close(figure)
    print(f"wrote {path}")


def panels(
    count: int, width: float = 5.2, height: float = 3.8, most: int | None = None
) -> tuple[Figure, list[Axes]]:
    """Returns a figure with ``count`` axes, at most ``most`` of them side by side."""
    columns = min(count, most or count)
    rows = math.ceil(count / columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(width * columns, height * rows), layout="constrained", squeeze=False
    )
    for each in axes.flat:
        dress(each)
    for spare in axes.flat[count:]:
        spare.set_visible(False)
    return figure, list(axes.flat[:count])


def line_figure(
    series: Sequence[Series], x: str, y: str, *, width: float, height: float, means: bool = True
) -> tuple[Figure, Axes]:
    """Returns a figure with one panel of ``series``, and its axes."""
    figure, (axes,) = panels(1, width, height)
    draw_series(axes, series, means=means)
    label(axes, x, y)
    legend(figure)
    return figure, axes


def dress(axes: Axes) -> None:
    """Gives ``axes`` a quiet frame and grid."""
    axes.grid(color="#dddddd", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#888888")
    axes.tick_params(colors=INK, labelsize=9)


def label(axes: Axes, x: str, y: str) -> None:
    """Labels both axes."""
    axes.set_xlabel(x, color=INK, fontsize=10)
    axes.set_ylabel(y, color=INK, fontsize=10)


def mean_line(lines: Sequence[Points]) -> Points:
    """Returns the mean of ``lines`` over the range that all of them cover; each line is
    interpolated linearly."""
    first, last = max(line[0, 0] for line in lines), min(line[-1, 0] for line in lines)
    every = np.unique(np.concatenate([line[:, 0] for line in lines]))
    at = every[(every >= first) & (every <= last)]
    values = [np.interp(at, line[:, 0], line[:, 1]) for line in lines]
    return np.stack((at, np.mean(values, axis=0)), axis=1)


def draw_series(axes: Axes, series: Sequence[Series], *, means: bool = True) -> None:
    """Draws each series in its own look: a thick line; or thin lines and, with ``means``, their
    mean as a thick one."""
    for index, (name, lines) in enumerate(series):
        lines = [line for line in lines if len(line)]
        if not lines:
            continue
        colour, dashes, marker = _LOOKS[index % len(_LOOKS)]
        thick = lines[0]
        if len(lines) > 1:
            for line in lines:
                axes.plot(*line.T, color=colour, linewidth=_THIN, alpha=0.55 if means else 1.0)
            if not means:
                axes.lines[-1].set_label(f"{name}, {len(lines)} seeds")
                continue
            thick = mean_line(lines)
            name = f"{name}, mean of {len(lines)} seeds"
        axes.plot(
            *thick.T,
            color=colour,
            linestyle=dashes,
            linewidth=_THICK,
            marker=marker,
            markersize=5,
            markevery=math.ceil(len(thick) / _MARKERS) if len(thick) else None,
            markeredgecolor="white",
            markeredgewidth=0.6,
            label=name,
            zorder=3,
        )


def draw_random(axes: Axes, rewards: Sequence[float]) -> None:
    """Draws the random policy's mean reward: a red line, and a band if it differs among runs."""
    if not rewards:
        return
    low, high, mean = min(rewards), max(rewards), sum(rewards) / len(rewards)
    if high > low:
        axes.axhspan(low, high, color=RANDOM, alpha=0.15, linewidth=0)
    # Games may score from -1 to 1, or thousands of points.
    names = dict.fromkeys(
        minus_signed(f"{reward:.{2 if abs(reward) < 10 else 1}f}") for reward in (low, high)
    )
    name = f"random policy, {' to '.join(names)}"
    axes.axhline(mean, color=RANDOM, linewidth=1.3, label=name, zorder=2)


def legend(figure: Figure) -> None:
    """Adds a legend above the figure, in as many columns as fit: of the axes with most lines, none
    if nothing was drawn."""
    named = (axes.get_legend_handles_labels() for axes in figure.axes)
    handles, labels = max(named, key=lambda each: len(each[1]))
    if not labels:
        return
    widest = _HANDLE + _LETTER * max(map(len, labels))
    columns = max(int(figure.get_figwidth() / widest), 1)
    figure.legend(
        handles,
        labels,
        loc="outside upper left",
        ncols=min(len(labels), columns),
        frameon=False,
        fontsize=9,
        handlelength=3.2,
        labelcolor=INK,
    )
