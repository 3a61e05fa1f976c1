"""`python -m benchmarks`: lists the benchmarks, or runs one of them, or all.

python -m benchmarks                     list of the benchmarks
python -m benchmarks env_steps --envs 2  one benchmark, with its own flags (the same as
                                         python -m benchmarks.env_steps --envs 2)
python -m benchmarks all                 all, with the flags of the published tables, into results/
"""

import runpy
import shlex
import sys
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from benchmarks.child import run_module, run_program
from benchmarks.registry import BENCHMARKS, RESULTS, experiments
from common.errors import InputError, choice

ALL = "all"


def main(arguments: Sequence[str]) -> None:
    if not arguments or arguments[0] in ("-h", "--help"):
        show_list()
        return
    name, *flags = arguments
    if name in BENCHMARKS:
        sys.argv[:] = [name, *flags]
        runpy.run_module(f"benchmarks.{name}", run_name="__main__", alter_sys=True)
    elif name == ALL and not flags:
        run_all()
    elif name == ALL:
        raise InputError("all runs with the published flags: give flags to a single benchmark.")
    elif name in experiments():
        raise InputError(f"{name} is an experiment: `python -m benchmarks.lab {name}` runs it.")
    else:
        raise InputError(f"there is no benchmark {name}: {choice(name, [*BENCHMARKS, ALL])}")


def show_list() -> None:
    """Prints every benchmark, what it measures and its published flags."""
    table = Table(title="python -m benchmarks NAME [--help]")
    for column in ("name", "what it measures", "results and the flags they are made with"):
        table.add_column(column, overflow="fold")
    for name, benchmark in BENCHMARKS.items():
        made = (f"{file}.json {flags}" for file, flags in benchmark.published.items())
        table.add_row(name, benchmark.measures, "\n".join(made))
    Console().print(table)
    print(
        "Experiments, with training and games, are in a list of their own: python -m benchmarks.lab"
    )


def run_all() -> None:
    """Measures all published results, each in a process of its own.

    Raises:
        InputError: a benchmark failed.
    """
    for name, benchmark in BENCHMARKS.items():
        for result, flags in benchmark.published.items():
            file = str(RESULTS / f"{result}.json")
            run_module(f"benchmarks.{name}", *shlex.split(flags), "--json", file)


if __name__ == "__main__":
    run_program(lambda: main(sys.argv[1:]))
