"""What the user sees during a run: a live screen, or plain lines where a screen is impossible.

A display whose terminal or pipe has gone falls silent. Learning goes on, as under `nohup`, and a
stop still completes.
"""

import os
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Self, TextIO

from rich.console import Console, ConsoleDimensions
from rich.live import Live
from rich.text import Text

from common.metrics import number
from common.process import log_lines
from common.process.output import silence
from common.process.progress import PLAIN_SECONDS
from common.protocol.live_view import ViewRequest
from common.schedule import Every, Now
from learner.telemetry import formats
from learner.telemetry.formats import fill
from learner.telemetry.live_feed import Asked, LiveFeed
from learner.telemetry.panels import finishing_note, metrics_of, troubles
from learner.telemetry.sinks.live_picture import LivePicture
from learner.telemetry.sinks.screen import Screen, picture_width
from learner.telemetry.sinks.sink import Sink
from learner.telemetry.snapshot import Snapshot


class Display(Sink, AbstractContextManager["Display"]):
    """Shows a run; a context manager that always gives the terminal back."""

    period = 1.0

    def __exit__(self, *_: object) -> None:
        """Gives the terminal back."""


def open_display(stream: TextIO | None = None, *, as_json: bool = False) -> Display:
    """Returns the live screen if ``stream``, by default standard output, is an able terminal;
    otherwise a display of lines."""
    stream = sys.stdout if stream is None else stream
    if as_json:
        return JsonDisplay(stream)
    if not stream.isatty():  # with FORCE_COLOR, rich would draw even into a log file
        return PlainDisplay(stream)
    console = Console(file=stream, highlight=False, markup=False, emoji=False)
    able = console.is_terminal and not console.is_dumb_terminal and os.environ.get("TERM")
    if not able or not console.encoding.lower().startswith("utf"):
        return PlainDisplay(stream)
    return LiveDisplay(console)


class LiveDisplay(Display):
    """One screen that is redrawn in place; other output scrolls by above it."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._console.size = self._size = _size_of(console)
        self._live = Live(
            console=console,
            auto_refresh=False,
            redirect_stdout=True,
            redirect_stderr=sys.stderr.isatty(),  # `2> file` stays a file
            vertical_overflow="crop",
        )
        self._gone = False
        self._feed: LiveFeed | None = None
        self._picture: LivePicture | None = None

    def watch(self, feed: LiveFeed) -> None:
        self._feed = feed

    def write(self, snapshot: Snapshot) -> None:
        self._try(lambda: self._draw(snapshot))

    def line(self, text: str) -> None:
        """Prints a line above the screen."""
        self._try(lambda: self._console.print(Text(formats.one_line(text))))

    def __enter__(self) -> Self:
        self._try(self._live.start)
        return self

    def __exit__(self, *_: object) -> None:
        self._gone = False  # standard output must be given back even if the terminal has gone
        self._try(self._live.stop)

    def _draw(self, snapshot: Snapshot) -> None:
        size = _size_of(self._console)
        if size != self._size:
            # Lines that a narrower window has wrapped cannot be overdrawn.
            self._console.size = self._size = size
            self._console.clear()
        self._look(snapshot)
        self._live.update(Screen(snapshot, self._picture), refresh=True)

    def _look(self, snapshot: Snapshot) -> None:
        """Asks for a picture of the first actor, if there is room for it."""
        alive = [actor.stats for actor in snapshot.present if actor.alive]
        first = min(alive, key=lambda stats: (stats.role, stats.name), default=None)
        if self._feed is None or first is None or not picture_width(*self._size):
            self._picture = None
            return
        view = self._feed.latest(Asked(first.role, first.name, ViewRequest()))
        if view is not None:
            self._picture = LivePicture(first, view)

    def _try(self, action: Callable[[], None]) -> None:
        if self._gone:
            return
        try:
            action()
        except OSError:
            self._gone = True


def _size_of(console: Console) -> ConsoleDimensions:
    """Returns the size of the console's own terminal; rich asks standard input and COLUMNS
    first."""
    try:
        columns, lines = os.get_terminal_size(console.file.fileno())
    except (OSError, ValueError):
        return console.size
    return ConsoleDimensions(columns, lines) if columns and lines else console.size


class PlainDisplay(Display):
    """Writes lines for a log: one every ten seconds, and one for each event.

    Args:
        stream: text stream; characters that its encoding lacks become ``?``.
    """

    def __init__(self, stream: TextIO, now: Now = time.monotonic) -> None:
        self._stream = stream
        self._schedule = Every(PLAIN_SECONDS, now)
        self._last: Snapshot | None = None
        self._gone = False

    def write(self, snapshot: Snapshot) -> None:
        """Writes changes of health checks at once, and the figures when they are due."""
        for text in _changed_checks(self._last, snapshot):
            self.line(text)
        turned = self._last is None or _chapter(self._last) != _chapter(snapshot)
        if turned or self._schedule.is_due():
            self.figures(snapshot)
            self._schedule.restart()
        self._last = snapshot

    def event(self, text: str) -> None:
        self.line(text)

    def figures(self, snapshot: Snapshot) -> None:
        """Writes the line of figures."""
        self.line(status_line(snapshot))

    def line(self, text: str) -> None:
        """Writes one line, with the time of day."""
        self._put(f"{time.strftime('%H:%M:%S')} {formats.one_line(text)}".translate(_ASCII))

    def _put(self, full: str) -> None:
        if self._gone:
            return
        encoding = getattr(self._stream, "encoding", None) or "utf-8"
        try:
            self._stream.write(full.encode(encoding, "replace").decode(encoding) + "\n")
            self._stream.flush()
        except OSError:
            self._gone = True
            silence(self._stream)


class JsonDisplay(PlainDisplay):
    """Writes the same lines as JSON objects (`common.process.log_lines`)."""

    def figures(self, snapshot: Snapshot) -> None:
        self._put(log_lines.line(status_line(snapshot), values=snapshot.values))

    def line(self, text: str) -> None:
        self._put(log_lines.line(formats.one_line(text)))


_ASCII = str.maketrans(
    {"−": "-", "–": "-", "ε": "epsilon", "≥": ">=", "…": "...", "→": "->", "∞": "never"}
)
"""ASCII in place of other characters, so that any terminal and grep can read a log."""


def status_line(snapshot: Snapshot) -> str:
    """Returns the figures of ``snapshot`` in one line."""
    values = snapshot.values
    phase = "warm-up" if values["run/phase"] == "warm-up" else fill("epoch {run/epoch}", values)
    done, total = (number(values, f"run/phase_{name}") or 0 for name in ("steps", "length"))
    where = f"{phase} {formats.share(done, total)}"
    if values["run/phase"] == "finishing":
        where += f", {finishing_note(values)}"
    elif values.get("run/seconds_left") is not None:
        where += fill(", {run/seconds_left} left", values)
    metrics = metrics_of(values["run/env"])
    actors = fill("{stream/actors_alive} of {stream/actors_present} actors", values)
    return " | ".join(
        (
            where,
            *(fill(each.line, values) for each in metrics if each.line),
            actors + troubles(values),
            f"health checks {snapshot.verdict}",
        )
    )


def _chapter(snapshot: Snapshot) -> tuple[object, ...]:
    return tuple(snapshot.values.get(key) for key in ("run/phase", "run/epoch", "play/test_epoch"))


def _changed_checks(last: Snapshot | None, snapshot: Snapshot) -> list[str]:
    before = {check.name for check in last.failed} if last is not None else set()
    lines = []
    for check in snapshot.checks:
        if check.passed is False and check.name not in before:
            lines.append(
                f"HEALTH CHECK RED: {check.name} is {formats.reading_and_bound(check)}: {check.why}"
            )
        if check.passed and check.name in before:
            lines.append(f"health check green again: {check.name} is {formats.reading(check)}")
    return lines
