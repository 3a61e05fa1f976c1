"""`python -m benchmarks.figures.plot runs/A runs/B -o figure.png`: the figures of runs and results.

`--figure epochs` (the report's Figures 6 to 9) and `--figure progress` (reward against steps and
wall clock) take folders of runs, or their ``epochs.csv`` under any name, those of 2017 too; runs
that are the same but for the seed become thin lines with their mean as a thick one.
`--figure delay` takes tables of `python -m benchmarks.lab.ladder` or `python -m
benchmarks.lab.actuation_latency`, `--figure race` files of `python -m benchmarks.lab.race --json`,
`--figure robustness` files of `python -m benchmarks.lab.robustness --json`, `--figure histogram`
files of `python -m learner --evaluate … --json`, `--figure scaling` one of
`python -m benchmarks.scaling --json`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from matplotlib.figure import Figure

from benchmarks.figures.plot_delay import delay_figure, read_ladders
from benchmarks.figures.plot_histogram import histogram_figure, read_evaluations
from benchmarks.figures.plot_race import race_figure
from benchmarks.figures.plot_robustness import read_grid, robustness_figure
from benchmarks.figures.plot_runs import Phase, epochs_figure, progress_figure, read_groups
from benchmarks.figures.plot_scaling import scaling_figure
from benchmarks.figures.plot_style import check_picture, save
from common.errors import InputError, exit_on_input_error


@dataclass(frozen=True)
class Options:
    """Draw runs, or the results of ladder, evaluation and scaling."""

    paths: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of runs or their CSV files; of delay and histogram, the files of results."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("figure.png")
    """Picture to write: .png, .svg or .pdf."""
    figure: Literal["epochs", "progress", "delay", "histogram", "race", "robustness", "scaling"] = (
        "epochs"
    )
    """Reward and mean max-Q by epoch; reward by steps and wall clock; score by delay of the keys
    (from ladder.csv or late_keys.csv); scores of the games of evaluations (from their JSON);
    score by wall clock of training (from the JSON of races);
    score by added latency and optics (from the JSON of robustness);
    steps per second by number of actors (from scaling.json)."""
    phase: Phase = "test"
    """Whose rewards epochs and progress show: each epoch's test, or its training with its ε."""

    def check(self) -> None:
        """Refuse what cannot be drawn.

        Raises:
            InputError: saying why.
        """
        if not self.paths:
            raise InputError("there is nothing to draw: name runs, as in runs/A runs/B.")
        for path in self.paths:
            if not path.exists():
                raise InputError(f"{path} is not there: name a run's folder or a file of results.")
        check_picture(self.output)


def draw(options: Options) -> Figure:
    """The figure that was asked for; whoever calls closes it."""
    match options.figure:
        case "epochs":
            return epochs_figure(read_groups(options.paths, options.phase))
        case "progress":
            return progress_figure(read_groups(options.paths, options.phase))
        case "delay":
            return delay_figure(read_ladders(options.paths))
        case "histogram":
            return histogram_figure(
                [each for path in options.paths for each in read_evaluations(path)]
            )
        case "race":
            return race_figure(options.paths)
        case "robustness":
            return robustness_figure([read_grid(path) for path in options.paths])
        case "scaling":
            return scaling_figure(options.paths[0])


def main() -> None:
    options = tyro.cli(Options, prog="python -m benchmarks.figures.plot")
    options.check()
    save(draw(options), options.output)


if __name__ == "__main__":
    exit_on_input_error(main)
