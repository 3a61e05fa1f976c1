"""The parts that every benchmark and experiment shares: its command line, its table and its JSON.

A benchmark is a module with ``Options`` (a `BenchmarkOptions` of its flags), ``measure(options) ->
Report``, and ``main(NAME, Options, measure)`` at its end. `benchmarks.registry` lists it.
"""

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

from annotated_types import Gt, MinLen
from rich.console import Console
from rich.table import Table as RichTable

from benchmarks.child import run_program
from common.atomic_file import write_json
from common.checked import FromOne
from common.command_line.parser import parse
from common.errors import InputError, writing
from learner.results_file import check_results_file
from learner.telemetry.provenance import machine_line, provenance

Numbers = Annotated[tuple[FromOne, ...], MinLen(1)]
Seconds = Annotated[float, Gt(0)]
Row = Mapping[str, Any]
T = TypeVar("T")
_MAX_PADDED = 12
"""Columns of a table that fits a terminal with spaces around each cell."""


@dataclass(frozen=True, kw_only=True)
class BenchmarkOptions:
    """The flags that every benchmark has."""

    json: Path | None = None
    """File for the results, as JSON. Earlier results in it are replaced, unless the experiment goes
    on with them."""

    def check(self) -> None:
        """Refuses what the bounds beside the fields cannot, such as a missing folder.

        Raises:
            InputError: a value is refused; the message names the flag.
        """
        if self.json is not None:
            check_results_file(self.json)


class Table(NamedTuple):
    """Rows that all have the same keys."""

    title: str
    rows: Sequence[Row]


@dataclass(frozen=True)
class Report:
    """The results of a benchmark, for people and for machines."""

    tables: Sequence[Table]
    """Tables for people."""
    content: Row
    """Content of the JSON file; versions, commit and machine are added to it."""
    notes: Sequence[str] = field(default=())
    """Sentences below the tables."""

    @classmethod
    def of(cls, title: str, rows: Sequence[Row], summary: Row, *notes: str) -> "Report":
        """Returns a report of one table, whose JSON has its rows and then ``summary``."""
        return cls([Table(title, rows)], {"title": title, **summary, "rows": rows}, notes)

    def publish(self, file: Path | None) -> None:
        """Prints the tables, and writes the JSON as `write` does."""
        for table in self.tables:
            show(*table)
        for note in self.notes:
            print(note)
        write(file, self.content)


O = TypeVar("O", bound=BenchmarkOptions)  # noqa: E741


def main(name: str, options: type[O], measure: Callable[[O], Report]) -> None:
    """Runs a benchmark as ``python -m benchmarks.NAME``, and ends the process."""
    run_program(lambda: run(name, options, measure, sys.argv[1:]))


def run(
    name: str, options: type[O], measure: Callable[[O], Report], arguments: Sequence[str]
) -> None:
    """Measures as ``arguments`` say, and publishes the report.

    Raises:
        InputError: the arguments are refused, or a measured process failed.
    """
    given = parse(options, f"benchmarks.{name}", arguments)
    given.check()
    provenance()  # of the code that measures, whatever is committed meanwhile
    measure(given).publish(given.json)


def show(title: str, rows: Sequence[Row]) -> None:
    """Prints ``rows`` as a table, with the machine below it."""
    wide = len(rows[0]) > _MAX_PADDED
    table = RichTable(title=title, padding=(0, 0) if wide else (0, 1))
    table.caption = machine_line(provenance()["machine"])
    for name in rows[0]:
        side: Literal["left", "right"] = "left" if isinstance(rows[0][name], str) else "right"
        table.add_column(name, justify=side, no_wrap=wide, min_width=3 if wide else None)
    for row in rows:
        table.add_row(*map(cell, row.values()))
    Console().print(table)


def write(file: Path | None, content: Row) -> None:
    """Writes ``content`` as JSON, with versions, commit and machine, unless ``file`` is None.

    The old file stays until the new one is complete, because it may be the work of days. Raises
    InputError if the file cannot be written.
    """
    if file is None:
        return
    with writing(file):
        write_json(file, {**content, **provenance()})


def resumed(file: Path | None, about: Row, what: str) -> dict[str, Any]:
    """Returns what an interrupted experiment left in ``file``; ``about`` if there is no file yet.

    Args:
        about: description of the experiment, in JSON's types; it is part of the results. An empty
            text in it may be missing in a file, which may be older than that part.
        what: name of the experiment for people.

    Raises:
        InputError: the file has the results of another experiment.
    """
    if file is None or not file.exists():
        return dict(about)
    try:
        found: dict[str, Any] = json.loads(file.read_bytes())
        same = all(found.get(name, "") == value for name, value in about.items())
    except (ValueError, AttributeError):
        same = False
    if not same:
        raise InputError(f"{file} holds no {what}: name another file.")
    return found


def measure_missing(
    file: Path | None,
    found: dict[str, Any],
    parts: str,
    asked: Sequence[Row],
    measure: Callable[..., Row],
) -> list[dict[str, Any]]:
    """Returns the list ``found[parts]`` with a part for each of ``asked``, new parts last.

    A missing part is made of what was asked and of the result of ``measure(**asked)``. After each
    part ``found`` is written to ``file``, so that the same command continues after an interruption.
    """
    done: list[dict[str, Any]] = found.setdefault(parts, [])
    missing: list[Row] = []
    for each in asked:
        if not any(each.items() <= part.items() for part in (*done, *missing)):
            missing.append(each)
    for each in with_time_left(
        missing, lambda each: ", ".join(f"{key} {each[key]}" for key in each)
    ):
        done.append({**each, **measure(**each)})
        write(file, found)
    return done


def with_time_left(
    work: Sequence[T], words: Callable[[T], str], size: Callable[[T], float] = lambda part: 1.0
) -> Iterator[T]:
    """Yields the parts of ``work``; before each, prints its ``words`` and the time that is left.

    Args:
        size: returns how long a part takes, compared with the others.
    """
    began = time.monotonic()
    done, whole = 0.0, sum(map(size, work))
    for number, part in enumerate(work, 1):
        minutes = (time.monotonic() - began) / (done or 1) * (whole - done) / 60
        left = f", about {minutes:.0f} min left" if done else ""
        print(f"{number} of {len(work)}{left}: {words(part)}", flush=True)
        yield part
        done += size(part)


@contextmanager
def reading(file: Path, what: str, benchmark: str) -> Iterator[Any]:
    """Yields the content of a JSON file that `write` wrote.

    An error while the caller reads from it also means that the file holds something else.

    Args:
        what: what the file should hold, for people.
        benchmark: name, and flags besides --json, of the benchmark that makes such a file.

    Raises:
        InputError: the file cannot be read, or holds something else.
    """
    try:
        yield json.loads(file.read_bytes())
    except (OSError, ValueError, TypeError, KeyError) as error:
        why = f"it has no {error}" if isinstance(error, KeyError) else error
        raise InputError(
            f"{file} holds no {what} ({why}): write it with "
            f"python -m benchmarks.{benchmark} --json FILE."
        ) from None


def scored(found: Row, places: int = 1) -> str:
    """Returns the mean score of games, and its deviation, as text for a table."""
    return f"{found['mean']:,.{places}f} ± {found['deviation']:,.{places}f}"


def cell(value: object) -> str:
    """Returns a value as text for a table."""
    if value is None:
        return "–"
    if not isinstance(value, float):
        return str(value)
    return f"{value:,.1f}" if abs(value) >= 10 else f"{value:.3g}"
