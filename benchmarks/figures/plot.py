"""`python -m benchmarks.figures.plot FILE … --figure NAME -o figure.png`: draws results.

It draws the figures of runs (`learner.figures.plot`) and others: `--figure latency` takes tables of
`python -m benchmarks.lab.hand_latency`; race, games, robustness, press and scaling take files
that the experiment of that name wrote with `--json`.
"""

from dataclasses import dataclass

from benchmarks.figures.plot_games import games_figure
from benchmarks.figures.plot_hand_latency import hand_latency_figure, read_hand_latency
from benchmarks.figures.plot_press import press_figure, read_press
from benchmarks.figures.plot_race import race_figure, read_races
from benchmarks.figures.plot_robustness import read_grid, robustness_figure
from benchmarks.figures.plot_scaling import scaling_figure
from common.process.program_end import exit_on_input_error
from learner.figures import plot
from learner.figures.plot_style import renamed


@dataclass(frozen=True)
class Options(plot.Options):
    """Draw runs, or the results of evaluations, experiments and benchmarks."""

    figure: str = "epochs"
    """Figure: 'epochs', 'progress' or 'histogram', as of `ale-robot plot`; 'latency', score against
    the hand's latency; 'race', score against wall clock; 'games', robots beside their twins without
    a body; 'robustness', score by latency and optics; 'press', time from a command to its keys; or
    'scaling', speed against actors."""


FIGURES: plot.Figures = {
    **plot.FIGURES,
    "latency": lambda options: hand_latency_figure(
        renamed(read_hand_latency(options.paths), options.names)
    ),
    "race": lambda options: race_figure(renamed(read_races(options.paths), options.names)),
    "games": lambda options: games_figure(options.paths[0]),
    "robustness": lambda options: robustness_figure([read_grid(path) for path in options.paths]),
    "press": lambda options: press_figure(read_press(options.paths[0])),
    "scaling": lambda options: scaling_figure(options.paths[0]),
}

if __name__ == "__main__":
    exit_on_input_error(lambda: plot.main(Options, "benchmarks.figures.plot", FIGURES))
