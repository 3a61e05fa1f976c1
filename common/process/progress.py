"""How far a command is: a bar in a terminal, and plain lines where there is none."""

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
"""Seconds between lines of whatever tells in a log how far it is."""
_RECENT = 600.0
"""Seconds whose speed tells what is left: games take minutes."""


class Progress(AbstractContextManager["Progress"]):
    """Tells on standard error how far a command is; a context manager, with the bar in between.

    Standard output has the results alone, so that it can be piped.

    Args:
        what: what is done, such as ``filming``.
        total: amount at which it is done; None if nobody knows.
        stream: where it tells; what its encoding lacks it writes in its own way.
    """

    def __init__(
        self,
        what: str,
        total: float | None,
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
        self._task = self._bar.add_task(what, total=total, note="")
        self._schedule = Every(PLAIN_SECONDS, now)
        self._schedule.restart()

    def update(
        self, done: float, *, total: float | None = None, what: str | None = None, note: str = ""
    ) -> None:
        """Tell that so much of the total is done.

        Args:
            total: another total than before.
            what: something else that is done now.
            note: figure of it, such as ``1,200 steps``.
        """
        self._bar.update(self._task, completed=done, total=total, description=what, note=note)
        if self._plain and self._schedule.is_due():
            self._line()

    def _line(self) -> None:
        (task,) = self._bar.tasks
        parts = [task.fields["note"]]
        if task.total is not None:
            parts.insert(0, f"{task.percentage:.0f} %")
        if (left := task.time_remaining) is not None:
            parts.append(f"{timedelta(seconds=left)} left")
        told = f"{task.description}: {', '.join(filter(None, parts))}"
        write_line(line(told, stamped=True), self._stream)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()
