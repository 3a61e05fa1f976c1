"""What the folder of a run tells, whether or not somebody works at it."""

import json
import shlex
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Self

from common.checked import MAX_COUNT
from common.metrics import METRICS, Metric, Value
from common.regular_file import read_file
from common.run.folder import RUNS, RunFolder
from common.run.newest_learner import NewestLearner
from learner.telemetry.formats import fill, played, scores


@dataclass(frozen=True)
class FolderReport:
    """What the files of a run on this machine tell."""

    name: str
    go_on: str
    """Command that continues it."""
    summary: dict[str, Any] = field(default_factory=dict)
    """Its ``summary.json``; empty if there is none."""
    written: str = ""
    """When that was written, local time; empty if it was not."""
    last_words: str = ""
    """Error with which its learner ended; empty if that was stopped, has all its steps, or was
    killed."""

    @classmethod
    def of(cls, folder: RunFolder) -> Self:
        """Reads the files of a run. What is missing or damaged counts as empty."""
        if (newest := NewestLearner.of(folder)) is not None:
            go_on = newest.command
        else:  # of a former version, or a copy
            here = folder.path.resolve().parent == RUNS.resolve()
            place = [] if here else ["--runs", str(folder.path.parent)]
            go_on = shlex.join(["ale-robot", "train", *place, "--run", folder.name, "--resume"])
        summary, written, last_words = {}, "", ""
        with suppress(OSError, ValueError, RecursionError):
            told = json.loads(read_file(folder.summary))
            summary = told if isinstance(told, dict) else {}
            at = datetime.fromtimestamp(folder.summary.stat().st_mtime)
            written = f"{at:%Y-%m-%d %H:%M}"
        with suppress(OSError, ValueError, RecursionError, LookupError, TypeError):
            last = json.loads(read_file(folder.logs / "learner.jsonl").splitlines()[-1])
            last_words = str(last["message"]) if last["level"] == "error" else ""
        return cls(folder.name, go_on, summary, written, last_words)

    @property
    def reason(self) -> str:
        """Says that nobody works at the run, and how to go on."""
        mended = "once that is mended, " if self.last_words else ""
        return f"nobody works at run {self.name}: {mended}go on with `{self.go_on}`"

    @property
    def values(self) -> dict[str, Value]:
        """Figures of the summary, by their keys in `METRICS`; None where there is none."""
        return {
            metric.key: _found(self.summary, metric)
            for metric in METRICS.values()
            if metric.summary
        }

    def lines(self) -> list[str]:
        """Returns, for a person, what is left of a run that has ended."""
        values = self.values
        if not self.summary:
            told = [f"run {self.name} ended before it had any figures"]
        else:
            phase = "epoch {run/epoch}" if values["run/epoch"] else "the warm-up"
            told = [
                fill(f"run {self.name}: {played(values)}, preset {{run/preset}}", values),
                fill(
                    f"ended on {self.written} in {phase}, after {{run/agent_steps}} "
                    "steps in {run/seconds}",
                    values,
                ),
                scores(values),
            ]
        told += [self.last_words] if self.last_words else []
        return told


def _found(summary: dict[str, Any], metric: Metric) -> Value:
    """Returns the figure in ``summary``; None if there is none of its kind."""
    found: Any = summary
    for name in metric.summary.split("."):
        found = found.get(name) if isinstance(found, dict) else None
    if metric.form == "text":
        return found if isinstance(found, str) else None
    is_number = isinstance(found, int | float) and not isinstance(found, bool)
    return found if is_number and abs(found) <= MAX_COUNT else None  # nor NaN
