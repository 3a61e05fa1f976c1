"""``gates.csv``: the health checks over a run, with a row for each point of its curves.

It has what TensorBoard shows, for everybody without TensorBoard.
"""

import csv
import io
from contextlib import suppress
from pathlib import Path

from common.atomic_file import append_whole, write_atomically
from common.metrics import METRICS, number
from common.regular_file import read_file
from learner.telemetry.sinks.sink import Sink
from learner.telemetry.snapshot import Snapshot


class GatesCsvSink(Sink):
    """Writes the rows of one run to a CSV file, which only a resume shortens.

    Its columns are the run's time, agent steps, each figure that `METRICS` gives a column here
    (empty while unknown), and the names of the red health checks.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._gates = {metric.gate: metric.key for metric in METRICS.values() if metric.gate}
        self.columns = ("seconds", "agent_steps", *self._gates, "red")

    def start(self, resumed_at: int | None) -> None:
        """Starts a new table, or keeps the complete rows up to ``resumed_at``.

        The last row may be torn, and a table of an earlier version may have fewer columns.
        """
        rows: list[dict[str, str]] = []
        if resumed_at is not None and self._path.exists():
            text = read_file(self._path).decode(errors="replace")
            with suppress(csv.Error):  # a cell without end, in a damaged table
                for row in csv.DictReader(text[: text.rfind("\n") + 1].splitlines()):
                    steps = row.get("agent_steps") or ""
                    whole = None not in row and None not in row.values()
                    if whole and steps.isdecimal() and float(steps) <= resumed_at:
                        rows.append(row)
        header = dict(zip(self.columns, self.columns, strict=True))
        write_atomically(self._path, self._lines(header, *rows))

    def write(self, snapshot: Snapshot) -> None:
        values = snapshot.values
        row = {
            name: f"{value:.6g}"
            for name, key in self._gates.items()
            if (value := number(values, key)) is not None
        }
        row["seconds"] = f"{number(values, 'run/seconds') or 0:.1f}"
        row["agent_steps"] = str(values["run/agent_steps"])
        row["red"] = "; ".join(check.name for check in snapshot.failed)
        append_whole(self._path, self._lines(row))

    def _lines(self, *rows: dict[str, str]) -> bytes:
        """Returns rows as CSV; missing values are empty, and values without a column are left
        out."""
        lines = io.StringIO()
        table = csv.DictWriter(lines, self.columns, extrasaction="ignore", lineterminator="\n")
        table.writerows(rows)
        return lines.getvalue().encode()
