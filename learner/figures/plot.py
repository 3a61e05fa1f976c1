"""`ale-robot plot runs/A runs/B -o figure.png`: the figures of runs and evaluations.

`--figure epochs` (the report's Figures 6 to 9) and `--figure progress` (reward against steps and
wall clock) take folders of runs, or their ``epochs.csv`` under any name, those of 2017 too; runs
that are the same but for the seed become thin lines with their mean as a thick one.
`--figure histogram` takes files of `ale-robot evaluate … --json`.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from matplotlib.figure import Figure

from common.errors import InputError, exit_on_input_error
from common.process.command_line import parse
from learner.figures.plot_histogram import histogram_figure, read_evaluations
from learner.figures.plot_runs import Phase, epochs_figure, progress_figure, read_groups
from learner.figures.plot_style import check_picture, save


@dataclass(frozen=True)
class Options:
    """Draw runs, or the results of evaluations."""

    paths: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of runs or their CSV files; or files of results."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("figure.png")
    """Picture to write: .png, .svg or .pdf."""
    figure: str = "epochs"
    """Figure: 'epochs', reward and mean max-Q by epoch; 'progress', reward by steps and wall clock;
    or 'histogram', scores of the games of evaluations (from their JSON)."""
    phase: Phase = "test"
    """Rewards that epochs and progress show: each epoch's test, or its training with its ε."""

    def check(self) -> None:
        """Refuse what cannot be drawn.

        Raises:
            InputError: saying why.
        """
        if self.figure not in FIGURES:
            known = ", ".join(FIGURES)
            raise InputError(f"there is no figure {self.figure!r}: choose one of {known}.")
        if not self.paths:
            raise InputError("there is nothing to draw: name runs, as in runs/A runs/B.")
        for path in self.paths:
            if not path.exists():
                raise InputError(f"{path} is not there: name a run's folder or a file of results.")
        check_picture(self.output)


FIGURES: dict[str, Callable[[Options], Figure]] = {
    "epochs": lambda options: epochs_figure(read_groups(options.paths, options.phase)),
    "progress": lambda options: progress_figure(read_groups(options.paths, options.phase)),
    "histogram": lambda options: histogram_figure(
        [each for path in options.paths for each in read_evaluations(path)]
    ),
}
"""What draws each figure; whoever calls it closes the figure."""


def main() -> None:
    options = parse(Options, "learner.figures.plot", sys.argv[1:])
    options.check()
    save(FIGURES[options.figure](options), options.output)


if __name__ == "__main__":
    exit_on_input_error(main)
