"""The figure of races: scores of tests against the wall clock of training."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.lab.ladder import MILESTONES
from benchmarks.lab.race import SHARED
from benchmarks.report import reading
from learner.figures.plot_style import INK, Points, Series, line_figure


def race_figure(series: Sequence[Series]) -> Figure:
    """Returns the figure of what `read_races` returned.

    Each race has a colour, and so has its peer; each seed has a line.
    """
    x, y = "wall clock of training (minutes)", "mean score of a game"
    figure, axes = line_figure(series, x, y, width=8.0, height=4.6, means=False)
    axes.set_xlim(left=0)
    for name, score in MILESTONES.items():
        axes.axhline(score, color="#888888", linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
        text = f"{score:g}" if name == f"{score:g}" else f"{score:g} ({name})"
        right = axes.get_yaxis_transform()
        axes.text(1.01, score, text, transform=right, va="center", fontsize=8, color=INK)
    return figure


def read_races(paths: Sequence[Path]) -> list[Series]:
    """Returns the races that `python -m benchmarks.lab.race` wrote to ``paths``, and their peers'.
    Those of the same settings are one series.

    Raises:
        InputError: a file holds something else, or nothing was tested yet.
    """
    lines: dict[tuple[str, ...], list[Points]] = {}
    for path in paths:
        for settings, series in _read(path):
            lines.setdefault((series.name, *settings), []).extend(series.lines)
    return [Series(name, found) for (name, *_), found in lines.items()]


def _read(path: Path) -> Iterator[tuple[list[str], Series]]:
    """Yields a race and its peer, each with the settings that tell it from others of its name."""
    with reading(path, "race", "lab.race") as found:
        lines = [
            _line((test["seconds"], test["mean"]) for test in run["tests"] if "mean" in test)
            for run in found["runs"]
        ]
        if not any(map(len, lines)):
            raise ValueError("nothing was tested")
        games = f"{found['games']} game{'s' if found['games'] != 1 else ''}"
        tests = f"tests of {games} at ε = {found['epsilon']:g}"
        settings = [str(found[name]) for name in SHARED]
        yield settings, Series(f"{found['title']}, {found['game']}, {tests}", lines)
        if peer := found.get("peer"):
            curve = _line((seconds, mean) for seconds, _, mean in peer["curve"])
            yield [found["game"]], Series(f"{peer['name']}, training games", [curve])


def _line(points: Iterable[tuple[float, float]]) -> Points:
    return np.array([(seconds / 60, mean) for seconds, mean in points]).reshape(-1, 2)
