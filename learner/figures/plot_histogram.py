"""The figure of an evaluation: a histogram of its scores."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.pyplot import subplots
from numpy.typing import NDArray

from common.counted import counted
from common.errors import InputError
from common.minus import minus_signed, points
from common.regular_file import read_file
from learner.figures.plot_style import INK, dress, label

_MAX_SINGLE = 60
"""Widest range of scores in which each whole score has a bar of its own."""
_BARS = 30
_GAP = 3.0
"""Width to which a wider gap between two scores is shortened."""
_BAR, _MEAN = "#67a9cf", "#0b3c6f"


class Evaluation(NamedTuple):
    """The scores of an evaluation by `ale-robot evaluate`."""

    name: str
    scores: list[float]
    mean: float
    deviation: float
    iqm: float


def read_evaluations(path: Path) -> list[Evaluation]:
    """Returns the evaluations in the JSON at ``path``, or in a policy's card: one, or those of a
    headline.

    Raises:
        InputError: the file holds no evaluation.
    """
    try:
        found = json.loads(read_file(path))
        found = found.get("evaluation", found)  # a policy's card has it
        evaluations = [
            _evaluation(f"{path.stem}, ε = {row['epsilon']:g}, sticky {row['sticky']:g}", row)
            for row in found.get("rows", ())
        ] or [_evaluation(path.stem, found)]
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise InputError(
            f"{path} holds no evaluation: write one with ale-robot evaluate NETWORK --json FILE."
        ) from None
    if not all(each.scores and np.isfinite(each.scores).all() for each in evaluations):
        raise InputError(f"{path} holds no evaluation: it has no scores.")
    return evaluations


def _evaluation(name: str, told: Mapping[str, Any]) -> Evaluation:
    mean, deviation, iqm = (float(told[key]) for key in ("mean", "deviation", "iqm"))
    return Evaluation(name, [float(score) for score in told["scores"]], mean, deviation, iqm)


def histogram_figure(evaluations: Sequence[Evaluation]) -> Figure:
    """Draws the number of games by score: one row for each evaluation, with a shared axis."""
    count = len(evaluations)
    figure, rows = subplots(
        count,
        1,
        figsize=(7.2, 0.7 + 1.4 * count),
        layout="constrained",
        sharex=True,
        sharey=True,
        squeeze=False,
    )
    every = [score for each in evaluations for score in each.scores]
    single = max(every) - min(every) <= _MAX_SINGLE
    scores, places = _axis(every) if single else (np.sort(every), np.sort(every))
    for axes, each in zip(rows[:, 0], evaluations, strict=True):
        dress(axes)
        axes.grid(visible=False)
        axes.spines["left"].set_visible(False)
        axes.set_yticks([])
        if single:
            found, games = np.unique(each.scores, return_counts=True)
            bars = axes.bar(np.interp(found, scores, places), games, 0.92, color=_BAR)
            # Labels have a white ground, so that the line of the mean does not cross them.
            ground = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
            axes.bar_label(bars, color=INK, fontsize=9, padding=2, bbox=ground, zorder=3)
        else:
            games, *_ = axes.hist(
                each.scores, _BARS, range=(min(every), max(every)), color=_BAR, edgecolor="white"
            )
        # The line is no higher than the bars, or it would stick out above the highest label.
        place = np.interp(each.mean, scores, places)
        axes.vlines(place, 0, games.max(), color=_MEAN, linewidth=1.8, alpha=0.7)
        axes.margins(y=0.25)
        mean, iqm = (minus_signed(f"{value:.2f}") for value in (each.mean, each.iqm))
        figures = (
            f"{counted(len(each.scores), 'game')}, mean {mean} ± {each.deviation:.2f} (line), "
            f"interquartile mean {iqm}"
        )
        axes.set_title(f"{each.name}\n{figures}", loc="left", fontsize=9, color=INK)
    if single:
        _mark(rows[-1, 0], scores, places)
    label(rows[-1, 0], "score of a game; above each bar the number of games", "")
    return figure


def _axis(every: Sequence[float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the scores that occur, and their places on the axis, which shortens wide gaps."""
    scores = np.unique(np.array(every, np.float64))
    steps = np.minimum(np.diff(scores, prepend=scores[0]), _GAP)
    return scores, np.cumsum(steps)


def _mark(axes: Axes, scores: NDArray[np.float64], places: NDArray[np.float64]) -> None:
    """Labels the axis with the scores, and with … where a gap is shortened."""
    shortened = np.flatnonzero(np.diff(scores) > _GAP)
    gaps = (places[shortened] + places[shortened + 1]) / 2
    names = list(map(points, scores))
    axes.set_xticks([*places, *gaps], [*names, *("…" for _ in gaps)])
