"""Finds the commit of each published result, and what keeps the result from being reproduced.

A result is reproduced by its flags at its commit. Two things can prevent that: tracked files that
differed from the commit (``git_dirty``), and what a ``note`` in the result says, such as a commit
that no longer exists.
"""

import csv
import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple


class Source(NamedTuple):
    """The commit of one result: a JSON file, a part of one, or a row of a table."""

    file: str
    part: str
    """Row or part of the file, for people; empty for the whole file."""
    commit: str
    dirty: bool | None
    """Whether tracked files differed from the commit; None if unknown."""
    note: str


def sources(folder: Path) -> Iterator[Source]:
    """Yields every result in the JSON files and tables of ``folder`` that names a commit."""
    for file in sorted(folder.iterdir()):
        if file.suffix == ".json":
            yield from _of_json(file.name, "", json.loads(file.read_text()))
        elif file.suffix == ".csv":
            with file.open(newline="", encoding="utf-8") as table:
                for row in csv.DictReader(table):
                    if row.get("git_commit"):
                        yield _of_row(file.name, row)


def _of_json(file: str, part: str, content: Any) -> Iterator[Source]:
    if isinstance(content, dict):
        if content.get("git_commit"):
            commit, dirty = content["git_commit"], content.get("git_dirty")
            yield Source(file, part, commit, dirty, content.get("note", ""))
        parts: Iterable[tuple[Any, Any]] = content.items()
    else:  # runs and cells, each of a commit of its own
        parts = enumerate(content, 1) if isinstance(content, list) else ()
    for name, inner in parts:
        yield from _of_json(file, f"{part} {name}".strip(), inner)


def _of_row(file: str, row: Mapping[str, str]) -> Source:
    names = ("rung", "label", "game", "seed") if "rung" in row else ("network",)
    part = ", ".join(row[name] for name in names if row[name])
    dirty = {"True": True, "False": False}.get(row.get("git_dirty", ""))
    return Source(file, part, row["git_commit"], dirty, row.get("note", ""))
