"""The figure of a robot's hands: time from a command to its keys, for every change of action."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.pyplot import get_cmap, subplots

from actors.robots.latency import FRAME_MS
from benchmarks.report import reading
from learner.figures.plot_style import INK

_DARK = 0.55
"""Share of the scale above which numbers are white."""


def read_press(path: Path) -> dict[str, Any]:
    """Returns what `python -m benchmarks.lab.press_latency --json` wrote to ``path``.

    Raises:
        InputError: the file holds no press latencies.
    """
    with reading(path, "press latency", "lab.press_latency") as found:
        np.array(found["table_ms"], np.float64)
        float(found["p50_ms"]), float(found["p99_ms"])  # null if the hands never pressed
    told: dict[str, Any] = found
    return told


def press_figure(found: Mapping[str, Any]) -> Figure:
    """Returns the table of medians from each action (row) to each other (column), coloured by
    emulator frames."""
    table = np.array(found["table_ms"], np.float64)  # null becomes NaN: never reached, or no change
    frames = max(int(np.nan_to_num(table).max() / FRAME_MS + 0.5), 1)
    figure, axes = subplots(figsize=(8.6, 7.4), layout="constrained")
    colours = get_cmap("YlGnBu", frames)
    bounds = (np.arange(frames + 1) + 0.5) * FRAME_MS
    image = axes.imshow(table, colours, BoundaryNorm([*bounds], colours.N))
    names = ["none" if name == "·" else name for name in found["actions"]]
    axes.set_xticks(range(len(names)), names, fontsize=9, color=INK)
    axes.set_yticks(range(len(names)), names, fontsize=9, color=INK)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set_xlabel("to this action", color=INK)
    axes.set_ylabel("from this action", color=INK)
    axes.set_title(
        f"Time from a command to its keys: half take at most {found['p50_ms']:.0f} ms, 99 % at "
        f"most {found['p99_ms']:.0f} ms\nU, D, L, R: up, down, left, right; F: fire",
        fontsize=10,
        loc="left",
        color=INK,
    )
    for (old, new), ms in np.ndenumerate(table):
        if not np.isnan(ms):
            colour = "white" if ms > _DARK * frames * FRAME_MS else INK
            axes.text(new, old, f"{ms:.0f}", ha="center", va="center", fontsize=8, color=colour)
    ticks = np.arange(1, frames + 1)
    bar = figure.colorbar(image, ax=axes, shrink=0.7, ticks=ticks * FRAME_MS)
    bar.set_ticks([*ticks * FRAME_MS], labels=[f"{n * FRAME_MS:.0f} ms" for n in ticks])
    bar.set_label("median, in emulator frames of 16.7 ms", color=INK)
    bar.ax.tick_params(length=0)
    bar.minorticks_off()
    bar.outline.set_visible(False)
    return figure
