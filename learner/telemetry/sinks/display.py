"""What the user sees while a run goes on: a live screen, or plain lines where there is none.

A display that can no longer show anything (the terminal has gone, the reader of the pipe too) falls
silent: that is no reason to stop learning under `nohup`, nor to leave a stop half done.
"""

import os
import sys
import time
from collections.abc import Callable
from typing import Protocol, Self, TextIO

from rich.console import Console, ConsoleDimensions
from rich.live import Live
from rich.text import Text

from common.process.output import silence
from learner.telemetry.sinks import formats as figures
from learner.telemetry.sinks.screen import Screen, time_troubles
from learner.telemetry.status import Status

PLAIN_SECONDS = 10.0


class Display(Protocol):
    """Shows a run; a context manager that gives the terminal back however it is left."""

    def show(self, status: Status) -> None:
        """Show the newest snapshot, its notes included; meant for about once a second."""

    def line(self, text: str) -> None:
        """Say one line that stays: where the run's files are, how it ended."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...


def open_display(stream: TextIO | None = None) -> Display:
    """The live screen where ``stream`` (standard output) is a terminal that can, else lines."""
    stream = sys.stdout if stream is None else stream
    if not stream.isatty():  # rich alone would let FORCE_COLOR draw into a log file
        return PlainDisplay(stream)
    console = Console(file=stream, highlight=False, markup=False, emoji=False)
    able = console.is_terminal and not console.is_dumb_terminal and os.environ.get("TERM")
    if not able or not console.encoding.lower().startswith("utf"):
        return PlainDisplay(stream)
    return LiveDisplay(console)


class LiveDisplay:
    """One screen, drawn anew in place; what others print scrolls by above it."""

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

    def show(self, status: Status) -> None:
        """Draw ``status`` in place of the one before."""
        self._try(lambda: self._draw(status))

    def line(self, text: str) -> None:
        """Print a line above the screen."""
        self._try(lambda: self._console.print(Text(figures.one_line(text))))

    def __enter__(self) -> Self:
        self._try(self._live.start)
        return self

    def __exit__(self, *_: object) -> None:
        self._gone = False  # standard output is to be given back even so
        self._try(self._live.stop)

    def _draw(self, status: Status) -> None:
        size = _size_of(self._console)
        if size != self._size:
            # Lines that a narrower window has wrapped cannot be drawn over.
            self._console.size = self._size = size
            self._console.clear()
        self._live.update(Screen(status), refresh=True)

    def _try(self, action: Callable[[], None]) -> None:
        if self._gone:
            return
        try:
            action()
        except OSError:
            self._gone = True


def _size_of(console: Console) -> ConsoleDimensions:
    """Size of the terminal it writes to; rich itself asks standard input first, then COLUMNS."""
    try:
        columns, lines = os.get_terminal_size(console.file.fileno())
    except (OSError, ValueError):
        return console.size
    return ConsoleDimensions(columns, lines) if columns and lines else console.size


class PlainDisplay:
    """Lines for a log: one every ten seconds, and one for each event.

    Args:
        stream: text stream; what its encoding lacks becomes ``?``.
        every: seconds between lines when nothing happens.
        clock: monotonic seconds.
    """

    def __init__(
        self,
        stream: TextIO,
        every: float = PLAIN_SECONDS,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._stream = stream
        self._every = every
        self._clock = clock
        self._shown: float | None = None
        self._last: Status | None = None
        self._gone = False

    def show(self, status: Status) -> None:
        """Say what is new: notes and gates at once, the figures when it is time."""
        for text in _new_notes(self._last, status):
            self.line(text)
        for text in _changed_gates(self._last, status):
            self.line(text)
        now = self._clock()
        turned = self._last is None or _chapter(self._last) != _chapter(status)
        if turned or self._shown is None or now - self._shown >= self._every:
            self.line(status_line(status))
            self._shown = now
        self._last = status

    def line(self, text: str) -> None:
        """Write one line, with the time of day."""
        if self._gone:
            return
        encoding = getattr(self._stream, "encoding", None) or "utf-8"
        full = f"{time.strftime('%H:%M:%S')} {figures.one_line(text)}".translate(_ASCII)
        try:
            self._stream.write(full.encode(encoding, "replace").decode(encoding) + "\n")
            self._stream.flush()
        except OSError:
            self._gone = True
            silence(self._stream)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass


_ASCII = str.maketrans({"−": "-", "–": "-", "ε": "epsilon", "≥": ">=", "…": "...", "→": "->"})
"""Lines in a log are read by any terminal, and by grep."""


def status_line(status: Status) -> str:
    """The figures of ``status`` in one line."""
    if status.phase == "warm-up":
        where = f"warm-up {figures.share(status.warmup_done, status.warmup)}"
    else:
        where = f"epoch {status.epoch} {figures.share(status.epoch_done, status.epoch_steps)}"
    if status.phase == "finishing":
        where += ", finishing"
    elif status.remaining is not None:
        where += f", {figures.duration(status.remaining)} left"
    reward = (
        f"reward train {figures.decimal(status.train_reward, 2)}"
        f" test {figures.decimal(status.test_reward, 2)}"
        f" random {figures.decimal(status.random_reward, 2)}"
    )
    stale = "/".join(
        figures.decimal(lag, 0) for lag in (status.staleness_p50, status.staleness_p95)
    )
    alive = sum(actor.alive for actor in status.present)
    unmeasured = sum(gate.passed is None for gate in status.gates)
    gates = f"gates {len(status.gates) - len(status.failed_gates) - unmeasured} green"
    if unmeasured:
        gates += f", {unmeasured} open"
    if status.failed_gates:
        gates += f", {len(status.failed_gates)} RED"
    hands = f"keys ms release {figures.delay(status.release)} press {figures.delay(status.press)}"
    return " | ".join(
        (
            where,
            f"{figures.count(status.agent_steps)} steps",
            reward,
            f"max-Q {figures.decimal(status.mean_max_q, 3)}",
            f"loss {figures.significant(status.loss)}",
            f"ε {figures.decimal(status.epsilon, 3)}",
            f"{figures.decimal(status.steps_per_second, 1)} steps/s",
            f"{figures.decimal(status.updates_per_second, 1)} updates/s",
            f"{figures.decimal(status.samples_per_insert, 2)} samples/insert"
            f" of {status.samples_per_insert_goal:g}",
            f"staleness {stale}",
            f"{alive} of {len(status.present)} actors{time_troubles(status.time)}",
            *([hands] if status.press.measured else []),
            gates,
        )
    )


def _chapter(status: Status) -> tuple[object, ...]:
    return status.phase, status.epoch, status.test_epoch


def _new_notes(last: Status | None, status: Status) -> tuple[str, ...]:
    """Notes that came since ``last``, whose own may have left the list at its old end."""
    before = last.notes if last is not None else ()
    now = status.notes
    for overlap in range(min(len(before), len(now)), 0, -1):
        if before[-overlap:] == now[:overlap]:
            return now[overlap:]
    return now


def _changed_gates(last: Status | None, status: Status) -> list[str]:
    before = {gate.name: gate.passed for gate in last.gates} if last is not None else {}
    lines = []
    for gate in status.gates:
        value = figures.significant(gate.value)
        if gate.passed is False and before.get(gate.name) is not False:
            lines.append(f"GATE RED: {gate.name} is {value}, not {gate.bound}: {gate.why}")
        if gate.passed and before.get(gate.name) is False:
            lines.append(f"gate green again: {gate.name} is {value}")
    return lines
