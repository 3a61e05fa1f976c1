"""`ale-robot plot runs/A runs/B -o figure.png`: draws figures of runs and evaluations.

`--figure epochs` draws the 2017 report's Figures 6 to 9, and `--figure progress` reward against
steps and wall clock. Both take folders of runs, or their ``epochs.csv`` under any name, including
those of 2017. Runs that differ only in the seed become thin lines, with their mean as a thick one.
`--figure histogram` takes files of `ale-robot evaluate … --json`. `--names` names the lines in the
legend.
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, TypeAlias

import tyro

from common.command_line.parser import parse
from common.errors import InputError
from common.process.extras import extra_for
from common.process.program_end import exit_on_input_error
from common.run.folder import RunFolder

with extra_for("a figure", "plot"):
    from matplotlib.figure import Figure

    from learner.figures.plot_histogram import histogram_figure, read_evaluations
    from learner.figures.plot_runs import Group, Phase, epochs_figure, progress_figure, read_groups
    from learner.figures.plot_style import check_figure, renamed, save


@dataclass(frozen=True)
class Options:
    """Plot runs, or the results of evaluations."""

    paths: tyro.conf.Positional[tuple[Path, ...]]
    """Runs, their folders or their CSV files; or JSON files of evaluations."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("figure.png")
    """Picture to write: .png, .svg or .pdf."""
    figure: str = "epochs"
    """Figure to draw: 'epochs', reward and mean max-Q by epoch; 'progress', reward by steps and
    wall clock; or 'histogram', scores of the games of evaluations (from their JSON)."""
    phase: Phase = "test"
    """Rewards in 'epochs' and 'progress': those of each epoch's test, or of its training with its
    ε."""
    names: tuple[str, ...] = ()
    """Names of the lines in the legend, in their order; by default those of the files."""

    def check(self, figures: "Figures") -> None:
        """Refuses a figure that is not in ``figures``, or that cannot be drawn.

        Raises:
            InputError: it says why.
        """
        if self.figure not in figures:
            known = ", ".join(figures)
            raise InputError(f"there is no figure {self.figure!r}: choose one of {known}.")
        if not self.paths:
            raise InputError("there is nothing to draw: name runs, as in A B.")
        for path in self.paths:
            if not path.exists():
                raise InputError(f"{path} does not exist: name a run or a results file.")
        check_figure(self.output)


Figures: TypeAlias = Mapping[str, Callable[[Options], Figure]]
"""Functions that draw a figure, by its name; the caller closes the figure."""

FIGURES: Figures = {
    "epochs": lambda options: epochs_figure(_groups(options)),
    "progress": lambda options: progress_figure(_groups(options)),
    "histogram": lambda options: histogram_figure(
        renamed([each for path in options.paths for each in read_evaluations(path)], options.names)
    ),
}
"""The figures of runs and evaluations."""


def _of_run(path: Path) -> Path:
    """Returns the folder of the run that ``path`` names, or else ``path`` itself."""
    run = None if path.exists() else RunFolder.named(path)
    return path if run is None else run.path


def _groups(options: Options) -> list[Group]:
    return renamed(read_groups(options.paths, options.phase), options.names)


def main(
    kind: type[Options] = Options, program: str = "learner.figures.plot", figures: Figures = FIGURES
) -> None:
    """Draws the figure that the command line names, one of ``figures``."""
    options = parse(kind, program, sys.argv[1:])
    options = replace(options, paths=tuple(map(_of_run, options.paths)))
    options.check(figures)
    save(figures[options.figure](options), options.output)


if __name__ == "__main__":
    exit_on_input_error(main)
