"""Prints a measurement as a table for people, and writes it as JSON for machines."""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from learner.telemetry.provenance import Provenance


def publish(
    title: str,
    rows: Sequence[Mapping[str, Any]],
    file: Path | None,
    summary: Mapping[str, Any] | None = None,
) -> None:
    """Show ``rows`` (all with the same keys), and write them.

    Args:
        file: where the same goes as JSON, with versions and commit; None for nowhere.
        summary: what else goes into the JSON, beside the rows.
    """
    show(title, rows)
    if file is not None:
        write(file, {"title": title, **(summary or {}), "rows": rows})


def show(title: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Print ``rows`` (all with the same keys) over the machine they were measured on."""
    machine = Provenance.gather().machine
    table = Table(title=title, caption=f"{machine.cpu}, {machine.cores} cores")
    for name in rows[0]:
        table.add_column(name, justify="left" if isinstance(rows[0][name], str) else "right")
    for row in rows:
        table.add_row(*map(cell, row.values()))
    Console().print(table)


def write(file: Path, content: Mapping[str, Any]) -> None:
    """Write ``content`` as JSON, with versions and commit."""
    file.parent.mkdir(parents=True, exist_ok=True)
    whole = {**content, **dataclasses.asdict(Provenance.gather())}
    file.write_text(json.dumps(whole, indent=2) + "\n")


def cell(value: object) -> str:
    """A value as it stands in a table."""
    if value is None:
        return "–"
    if not isinstance(value, float):
        return str(value)
    return f"{value:,.1f}" if abs(value) >= 10 else f"{value:.3g}"
