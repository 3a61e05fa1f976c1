"""The figure of games: scores of training, of robots and of their twins without a body."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.lab.games import ANCHORS, BODIES
from benchmarks.report import reading
from learner.figures.plot_style import INK, RANDOM, Series, draw_series, legend, panels

_COLUMNS = 4


def games_figure(path: Path) -> Figure:
    """Returns a panel for each game in the file ``path`` that `python -m benchmarks.lab.games`
    wrote.

    A panel has the mean scores of training games by training steps, random play, and a human's
    score if it is near.

    Raises:
        InputError: the file holds something else, or no run yet.
    """
    with reading(path, "games", "lab.games") as content:
        found: list[dict[str, Any]] = content["runs"]
        games = {
            run["game"]: [each for each in found if each["game"] == run["game"]] for run in found
        }
        lines = {
            game: [
                Series(BODIES[run["env"]], [np.array(run["curve"]).reshape(-1, 2) / (1_000, 1)])
                for run in sorted(runs, key=lambda run: list(BODIES).index(run["env"]))
            ]
            for game, runs in games.items()
        }
        if not games:
            raise ValueError("no run has ended")
    figure, axes = panels(len(games), 3.2, 2.7, most=_COLUMNS)
    for each, (game, series) in zip(axes, lines.items(), strict=True):
        draw_series(each, series)
        random = next(
            (r["random_reward"] for r in games[game] if r["random_reward"] is not None), None
        )
        if random is not None:
            each.axhline(random, color=RANDOM, linewidth=1.3, label="random play", zorder=2)
        top = max(
            (line[:, 1].max() for one in series for line in one.lines if len(line)), default=0
        )
        if (anchors := ANCHORS.get(game)) and anchors.human < 2 * top:
            each.axhline(
                anchors.human,
                color=INK,
                linewidth=0.8,
                linestyle=(0, (4, 3)),
                zorder=1,
                label="human",
            )
        each.set_title(game.replace("_", " "), loc="left", fontsize=10, color=INK)
    figure.supxlabel("training steps, thousands", fontsize=10, color=INK)
    figure.supylabel("mean score of training games", fontsize=10, color=INK)
    legend(figure)
    return figure
