"""``gates.csv``: the gates over a run, a row for each point of its curves.

What TensorBoard shows, for everybody who has none.
"""

import csv
import io
from pathlib import Path

from common.run_folder import write_atomically
from learner.gates import GATES
from learner.status import Status

COLUMNS = ("seconds", "agent_steps", *(name.replace(" ", "_") for name in GATES), "red")
"""Run's time, agent steps, each gate's value (empty while unknown), and which are red."""


class GateTable:
    """The rows of one run, in a CSV file that only grows, but for a resume.

    Args:
        resumed_at: agent steps of the checkpoint that was resumed, whose later rows, of a life
            that was lost, are dropped. None for a new run.
    """

    def __init__(self, path: Path, resumed_at: int | None = None) -> None:
        self._path = path
        lines = [",".join(COLUMNS) + "\n"]
        if resumed_at is not None and path.exists():
            lines += _kept(path.read_text(encoding="utf-8", errors="replace"), resumed_at)
        write_atomically(path, "".join(lines).encode())

    def add(self, status: Status) -> None:
        """A row of ``status``."""
        values = {gate.name: gate.value for gate in status.gates}
        line = io.StringIO()
        csv.writer(line, lineterminator="\n").writerow(
            (
                f"{status.elapsed:.1f}",
                status.agent_steps,
                *("" if values.get(name) is None else f"{values[name]:.6g}" for name in GATES),
                "; ".join(gate.name for gate in status.failed_gates),
            )
        )
        with self._path.open("a", encoding="utf-8") as file:
            file.write(line.getvalue())


def _kept(text: str, agent_steps: int) -> list[str]:
    """Whole rows up to ``agent_steps``; the last may have been torn."""
    kept = []
    for line in text.splitlines(keepends=True)[1:]:
        cells = line.split(",")
        whole = line.endswith("\n") and len(cells) == len(COLUMNS) and cells[1].isdecimal()
        if whole and int(cells[1]) <= agent_steps:
            kept.append(line)
    return kept
