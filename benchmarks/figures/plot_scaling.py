"""The figure of scaling: agent steps per second against the number of actors."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.report import reading
from learner.figures.plot_style import Series, line_figure

_LINES = {
    "training, evaluator idle": "train_steps_per_second",
    "training beside a test": "train_steps_per_second_beside_test",
    "a test beside training": "test_steps_per_second_beside_training",
}


def scaling_figure(path: Path) -> Figure:
    """Returns the figure of what `python -m benchmarks.scaling` wrote to ``path``.

    Raises:
        InputError: the file holds something else.
    """
    with reading(path, "scaling", "scaling") as content:
        found = content["scaling"]
        series = [
            Series(name, [np.array([(each["actors"], each[rate]) for each in found], np.float64)])
            for name, rate in _LINES.items()
        ]
    figure, axes = line_figure(series, "actors", "agent steps per second", width=6.5, height=3.8)
    axes.set_xticks([each["actors"] for each in found])
    axes.set_ylim(bottom=0)
    return figure
