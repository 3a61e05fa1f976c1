"""`python -m benchmarks.figures.plot FILE … --figure NAME -o figure.png`: the figures of results.

Beside those of runs (`learner.figures.plot`): `--figure delay` takes tables of `python -m
benchmarks.lab.ladder` or `python -m benchmarks.lab.actuation_latency`, `--figure race` files of
`python -m benchmarks.lab.race --json`, `--figure robustness` files of `python -m
benchmarks.lab.robustness --json`, `--figure scaling` one of `python -m benchmarks.scaling --json`.
"""

from benchmarks.figures.plot_delay import delay_figure, read_ladders
from benchmarks.figures.plot_race import race_figure
from benchmarks.figures.plot_robustness import read_grid, robustness_figure
from benchmarks.figures.plot_scaling import scaling_figure
from common.errors import exit_on_input_error
from learner.figures.plot import FIGURES, main

FIGURES |= {
    "delay": lambda options: delay_figure(read_ladders(options.paths)),
    "race": lambda options: race_figure(options.paths),
    "robustness": lambda options: robustness_figure([read_grid(path) for path in options.paths]),
    "scaling": lambda options: scaling_figure(options.paths[0]),
}

if __name__ == "__main__":
    exit_on_input_error(main)
