"""The progress of a command: a bar in a terminal, or else plain lines."""

import sys
import time
from contextlib import AbstractContextManager
from datetime import timedelta
from typing import Self, TextIO

from rich import progress
from rich.console import Console

from common.process.log_lines import line, write_line
from common.schedule import Every, Now

PLAIN_SECONDS = 10.0
"""Seconds between plain lines of progress."""
_BEGUN = sys.float_info.min
"""Amount that is done at the beginning: rich measures the speed from the first amount above 0 on,
and two games that end together would take no time."""
_LONGEST = 365 * 86_400
"""Seconds left beyond which they are not told."""
_RECENT = 600.0
"""Seconds over which the speed is measured for the time left; long, because games take minutes."""


class Progress(AbstractContextManager["Progress"]):
    """Shows the progress of a command on standard error; the bar is shown within the context.

    Standard output has only the results, so that it can be piped.

    Args:
        what: what is being done, such as ``filming``.
        total: amount at which it is done; None if it is unknown.
        note: first line of a log, if the first update may take minutes.
        stream: where progress is shown, by default standard error.
    """

    def __init__(
        self,
        what: str,
        total: float | None,
        note: str = "",
        *,
        stream: TextIO | None = None,
        now: Now = time.monotonic,
    ) -> None:
        self._stream = sys.stderr if stream is None else stream
        console = Console(file=self._stream)
        # Rich alone would let FORCE_COLOR draw into a log.
        self._plain = not self._stream.isatty() or console.is_dumb_terminal
        self._bar = progress.Progress(
            progress.TextColumn("{task.description}"),
            progress.BarColumn(),
            progress.TextColumn("{task.fields[note]}"),
            progress.TimeRemainingColumn(),
            console=console,
            transient=True,
            redirect_stdout=sys.stdout.isatty(),  # `> file` stays a file
            disable=self._plain,
            get_time=now,
            speed_estimate_period=_RECENT,
        )
        self._task = self._bar.add_task(what, total=total, note=note if self._plain else "")
        self._schedule = Every(PLAIN_SECONDS, now)
        self._schedule.restart()

    def update(self, done: float, *, total: float | None = None, note: str = "") -> None:
        """Shows that ``done`` of the total is done.

        Args:
            total: a new total, if it has changed.
            note: a figure to show beside it, such as ``1,200 steps``.
        """
        self._bar.update(self._task, completed=done, total=total, note=note)
        if self._plain and self._schedule.is_due():
            self._line()

    def _line(self) -> None:
        (task,) = self._bar.tasks
        parts = [task.fields["note"]]
        if task.total is not None:
            parts.insert(0, f"{task.percentage:.0f} %")
        if (left := task.time_remaining) is not None and left <= _LONGEST:
            parts.append(f"{timedelta(seconds=left)} left")
        told = f"{task.description}: {', '.join(filter(None, parts))}"
        write_line(line(told, stamped=True), self._stream)

    def __enter__(self) -> Self:
        self._bar.start()
        self._bar.update(self._task, completed=_BEGUN)
        if self._plain and self._bar.tasks[0].fields["note"]:
            self._line()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()
