"""What the folder of a run tells, whether or not somebody works at it."""

import json
import shlex
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Literal, Self

from common.checked import MAX_COUNT
from common.endpoint import DEFAULT_ENDPOINT
from common.metrics import METRICS, Metric, Value
from common.regular_file import read_file
from common.run.folder import RUNS, RunFolder
from common.run.newest_learner import Ended, NewestLearner
from common.strict_json import strict
from learner.telemetry.formats import fill, played, scores


@dataclass(frozen=True)
class FolderReport:
    """What the files of a run on this machine tell."""

    name: str
    resume_command: str
    """Command that continues it."""
    summary: dict[str, Any] = field(default_factory=dict)
    """Its ``summary.json``; empty if there is none."""
    written: str = ""
    """When that was written, local time; empty if it was not."""
    error: str = ""
    """Error with which its learner ended; empty if there was none."""
    ended: Ended | Literal["killed", "ended"] = "ended"
    """How its learner ended if there was no error; "ended" of one that does not say how."""
    endpoint: str = DEFAULT_ENDPOINT
    """Address at which its newest learner is or was found."""

    @classmethod
    def of(cls, folder: RunFolder) -> Self:
        """Reads the files of a run. What is missing or damaged counts as empty."""
        newest = NewestLearner.of(folder)
        if newest is not None:
            resume_command = newest.command
        else:  # of a former version, or a copy
            here = folder.path.resolve().parent == RUNS.resolve()
            place = [] if here else ["--runs", str(folder.path.parent)]
            resume_command = shlex.join(
                ["ale-robot", "train", *place, "--run", folder.name, "--resume"]
            )
        summary: dict[str, Any] = {}
        written, error = "", ""
        with suppress(OSError, ValueError, RecursionError):
            told = json.loads(read_file(folder.summary))
            summary = strict(told) if isinstance(told, dict) else {}
            at = datetime.fromtimestamp(folder.summary.stat().st_mtime)
            written = f"{at:%Y-%m-%d %H:%M}"
        with suppress(OSError, ValueError, RecursionError, LookupError, TypeError):
            last = json.loads(read_file(folder.logs / "learner.jsonl").splitlines()[-1])
            error = str(last["message"]) if last["level"] == "error" else ""
        ended = "ended" if newest is None else newest.ended or "killed"
        endpoint = DEFAULT_ENDPOINT if newest is None else newest.endpoint
        return cls(folder.name, resume_command, summary, written, error, ended, endpoint)

    @property
    def reason(self) -> str:
        """Says that nobody works at the run, and how to go on."""
        if self.how == "done":
            return f"run {self.name} has all its steps: train on with `{self.resume_command}`"
        mended = "once that is mended, " if self.error else ""
        return f"nobody works at run {self.name}: {mended}go on with `{self.resume_command}`"

    @property
    def how(self) -> str:
        """How its learner ended, in one word."""
        return "failed" if self.error else self.ended

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
                f"run {self.name}: {played(values)}, " + fill("preset {run/preset}", values),
                fill(
                    f"{self.how} on {self.written} in {phase}, after {{run/agent_steps}} "
                    "steps in {run/seconds}",
                    values,
                ),
                scores(values),
            ]
        told += [self.error] if self.error else []
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
