"""``ale-robot runs``, or ``python -m learner.runs``: lists the runs of a folder."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich import box
from rich.console import Console
from rich.table import Column, Table

from common.command_line.parser import parse
from common.endpoint import DEFAULT_ENDPOINT
from common.errors import InputError
from common.process.program_end import exit_on_input_error
from common.run.folder import RUNS, RunFolder
from common.strict_json import dumps
from learner.folder_report import FolderReport
from learner.telemetry.formats import UNKNOWN, figure, one_line, played

_FIGURES = {
    "steps": "run/agent_steps",
    "time": "run/seconds",
    "train": "play/train_reward",
    "best\ntest": "play/best_test_reward",
}
"""Figures of the table, by the heads of their columns."""
_AT_WORK = "at work"
_NAME_WIDTH = 24
"""Maximum number of columns that a run's name gets, however narrow the terminal."""


@dataclass(frozen=True)
class RunsOptions:
    """List the runs of a folder: what they play, how far they came, and who works at them."""

    runs: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="[FOLDER]")] = RUNS
    """Folder that holds the runs."""
    json: bool = False
    """JSON, with all figures, instead of a table."""

    def check(self) -> None:
        """Raises InputError for a folder that is not there, or is that of one run."""
        there = self.runs == RUNS or self.runs.is_dir()
        if (run := (RunFolder.at if there else RunFolder.named)(self.runs)) is not None:
            raise InputError(
                f"{self.runs} is a run: `ale-robot status {self.runs}` tells of it; omit it for a "
                f"list of those in {run.path.parent}."
            )
        if not there:
            raise InputError(f"there is no folder {self.runs}: name one that holds runs.")


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the list."""
    given = sys.argv[1:] if arguments is None else arguments
    options = parse(RunsOptions, "learner.runs", given)
    options.check()
    place = options.runs
    if not (runs := RunFolder.all_in(place)) and (runs := RunFolder.all_in(place / RUNS)):
        place /= RUNS  # such as of a checkout
    if options.json:
        print(dumps([_told(run) for run in runs]))
        return
    if not runs:
        begin = ": `ale-robot train` begins one" if options.runs == RUNS else ""
        print(f"There are no runs in {options.runs.resolve()}{begin}.")
        return
    heads = [Column(head, justify="right", no_wrap=True) for head in _FIGURES]
    longest = max(len(run.name) for run in runs)
    names = Column("run", overflow="fold", min_width=min(longest, _NAME_WIDTH))
    table = Table(names, "plays", *heads, "state", box=box.SIMPLE, padding=(0, 1, 0, 0))
    for run in runs:
        table.add_row(*map(one_line, _row(run)))
    console = Console(highlight=False, markup=False, emoji=False)
    console.print(table)
    where = "" if place == RUNS else f"{place}/"
    console.print(f"One of them: ale-robot status {where}RUN", soft_wrap=True)


def _row(run: RunFolder) -> tuple[str, ...]:
    report = FolderReport.of(run)
    values = report.values
    plays = played(values) if report.summary else UNKNOWN
    figures = (figure(key, values) for key in _FIGURES.values())
    return (run.name, plays, *figures, _state(run, report))


def _state(run: RunFolder, report: FolderReport) -> str:
    """Returns where somebody works at a run; or how it ended, and at which time of today or on
    which day."""
    state = _how(run, report)
    if state == _AT_WORK:
        return state if report.endpoint == DEFAULT_ENDPOINT else f"{state} at {report.endpoint}"
    day, _, time = report.written.partition(" ")
    today = date.today()
    when = time if day == f"{today:%Y-%m-%d}" else day.removeprefix(f"{today:%Y-}")
    return f"{state} {when}".strip()


def _how(run: RunFolder, report: FolderReport) -> str:
    """Returns whether somebody works at a run, or how it ended."""
    try:
        return _AT_WORK if run.is_at_work() else report.how
    except OSError:  # such as another user's, whose locks cannot be opened
        return "unknown"


def _told(run: RunFolder) -> dict[str, Any]:
    report = FolderReport.of(run)
    return {
        "run": run.name,
        "folder": str(run.path.resolve()),
        "state": _how(run, report),
        "written": report.written or None,
        "error": report.error or None,
        "summary": report.summary or None,
    }


if __name__ == "__main__":
    exit_on_input_error(main)
