"""``gates.csv``: the gates over a run, a row for each point of its curves.

What TensorBoard shows, for everybody who has none.
"""

import csv
import io
from pathlib import Path

from common.run.folder import write_atomically
from learner.telemetry.health_checks import GATES
from learner.telemetry.status import Status

COLUMNS = (
    "seconds",
    "agent_steps",
    *(name.replace(" ", "_") for name in GATES),
    "press_p50_ms",
    "release_p50_ms",
    "release_p99_ms",
    "red",
)
"""Run's time, agent steps, each gate's value and the hands' other latencies (empty while unknown),
and which gates are red."""


class GateTable:
    """The rows of one run, in a CSV file that only grows, but for a resume.

    Args:
        resumed_at: agent steps of the checkpoint that was resumed, whose later rows, of a life
            that was lost, are dropped. None for a new run.
    """

    def __init__(self, path: Path, resumed_at: int | None = None) -> None:
        self._path = path
        rows = [dict(zip(COLUMNS, COLUMNS, strict=True))]
        if resumed_at is not None and path.exists():
            rows += _kept(path.read_text(encoding="utf-8", errors="replace"), resumed_at)
        write_atomically(path, "".join(map(_line, rows)).encode())

    def add(self, status: Status) -> None:
        """A row of ``status``."""
        row = {
            name: f"{value:.6g}" for name, value in status.gate_figures.items() if value is not None
        }
        row["seconds"] = f"{status.elapsed:.1f}"
        row["agent_steps"] = str(status.agent_steps)
        row["red"] = "; ".join(gate.name for gate in status.failed_gates)
        with self._path.open("a", encoding="utf-8") as file:
            file.write(_line(row))


def _line(row: dict[str, str]) -> str:
    """Cells by their columns' names; those that are missing stay empty."""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(row.get(name, "") for name in COLUMNS)
    return line.getvalue()


def _kept(text: str, agent_steps: int) -> list[dict[str, str]]:
    """Whole rows up to ``agent_steps``; the last may have been torn, and a table of an earlier
    version may have had fewer columns."""
    kept = []
    names, *rows = [line.split(",") for line in text.split("\n")[:-1]] or [[]]
    for cells in rows:
        row = dict(zip(names, cells, strict=False))
        steps = row.get("agent_steps", "")
        if len(cells) == len(names) and steps.isdecimal() and int(steps) <= agent_steps:
            kept.append(row)
    return kept
