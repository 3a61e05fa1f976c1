"""The figure of an evaluation: how often each score was reached."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.pyplot import subplots
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from common.errors import InputError
from learner.figures.plot_style import INK, dress, label

_MOST_SINGLE = 60
"""Widest range of scores in which each whole score has a bar of its own."""
_BARS = 30
_BAR, _MEAN = "#67a9cf", "#0b3c6f"


class Evaluation(NamedTuple):
    """What `python -m learner --evaluate` found."""

    name: str
    scores: list[float]
    mean: float
    deviation: float
    iqm: float


def read_evaluations(path: Path) -> list[Evaluation]:
    """The evaluation in the JSON at ``path``, or those of a headline.

    Raises:
        InputError: it holds none.
    """
    try:
        found = json.loads(path.read_text())
        evaluations = (
            [_evaluation(path.stem, found)]
            if "rows" not in found
            else [
                _evaluation(f"{path.stem}, ε = {row['epsilon']:g}, sticky {row['sticky']:g}", row)
                for row in found["rows"]
            ]
        )
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise InputError(
            f"{path} holds no evaluation ({error!r}): write one with "
            "python -m learner --evaluate FILE --json FILE."
        ) from None
    if not all(each.scores and np.isfinite(each.scores).all() for each in evaluations):
        raise InputError(f"{path} holds no evaluation: it has no scores.")
    return evaluations


def _evaluation(name: str, told: Mapping[str, Any]) -> Evaluation:
    mean, deviation, iqm = (float(told[key]) for key in ("mean", "deviation", "iqm"))
    return Evaluation(name, [float(score) for score in told["scores"]], mean, deviation, iqm)


def histogram_figure(evaluations: Sequence[Evaluation]) -> Figure:
    """Games by score; one row for each evaluation, all over the same scores."""
    count = len(evaluations)
    figure, rows = subplots(
        count,
        1,
        figsize=(6.5, 1.2 + 2.1 * count),
        layout="constrained",
        sharex=True,
        sharey=True,
        squeeze=False,
    )
    edges = _edges([score for each in evaluations for score in each.scores])
    for axes, each in zip(rows[:, 0], evaluations, strict=True):
        dress(axes)
        axes.grid(visible=False, axis="x")
        axes.hist(each.scores, edges, color=_BAR, edgecolor="white", linewidth=0.6)
        axes.axvline(each.mean, color=_MEAN, linewidth=1.8)
        axes.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=5))
        figures = (
            f"{len(each.scores)} games, mean {each.mean:.2f} ± {each.deviation:.2f} (line), "
            f"interquartile mean {each.iqm:.2f}"
        ).replace("-", "−")
        axes.set_title(f"{each.name}\n{figures}", loc="left", fontsize=9, color=INK)
        label(axes, "", "games")
    rows[-1, 0].xaxis.set_major_locator(MaxNLocator(integer=True))
    label(rows[-1, 0], "score of a game", "games")
    return figure


def _edges(scores: Sequence[float]) -> NDArray[np.float64]:
    """Of the bars: one for each score where those are few, else of equal widths."""
    low, high = np.floor(min(scores)), np.ceil(max(scores))
    if high - low <= _MOST_SINGLE:
        return np.arange(low - 1.5, high + 2.5)
    return np.linspace(low, high, _BARS + 1)
