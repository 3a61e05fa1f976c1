"""Prints a measurement as a table for people, and writes it as JSON for machines."""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from learner.provenance import Provenance


def publish(title: str, rows: Sequence[Mapping[str, Any]], file: Path | None) -> None:
    """Show ``rows`` (all with the same keys) under the machine they were measured on.

    Args:
        file: where the same goes as JSON, with versions and commit; None for nowhere.
    """
    here = Provenance.gather()
    machine = here.machine
    table = Table(title=title, caption=f"{machine.cpu}, {machine.cores} cores")
    for name in rows[0]:
        table.add_column(name, justify="left" if isinstance(rows[0][name], str) else "right")
    for row in rows:
        table.add_row(*(f"{v:,.1f}" if isinstance(v, float) else str(v) for v in row.values()))
    Console().print(table)
    if file is not None:
        content = {"title": title, "rows": rows, **dataclasses.asdict(here)}
        file.write_text(json.dumps(content, indent=2) + "\n")
