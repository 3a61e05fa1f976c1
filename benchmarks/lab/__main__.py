"""`python -m benchmarks.lab`: lists the experiments, or runs one of them.

python -m benchmarks.lab                   list of the experiments
python -m benchmarks.lab race --env ale    one experiment, with its own flags (the same as
                                           python -m benchmarks.lab.race --env ale)
"""

import runpy
import sys
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from benchmarks.child import run_program
from benchmarks.registry import experiments
from common.errors import InputError, choice


def main(arguments: Sequence[str]) -> None:
    if not arguments or arguments[0] in ("-h", "--help"):
        show_list()
        return
    name, *flags = arguments
    if name not in experiments():
        raise InputError(f"there is no experiment {name}: {choice(name, [*experiments()])}")
    sys.argv[:] = [name, *flags]
    runpy.run_module(f"benchmarks.lab.{name}", run_name="__main__", alter_sys=True)


def show_list() -> None:
    """Prints every experiment, and what it measures."""
    table = Table(title="python -m benchmarks.lab NAME [--help]")
    for column in ("name", "what it measures"):
        table.add_column(column, overflow="fold")
    for name, measures in experiments().items():
        table.add_row(name, measures)
    Console().print(table)


if __name__ == "__main__":
    run_program(lambda: main(sys.argv[1:]))
