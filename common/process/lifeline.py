"""Ends a process in order: at a signal, or when its parent has gone.

Programs import this module first. It loads no other module of the project at that time, because an
interrupt before `leave_at_interrupt` prints a traceback.
"""

import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress

_TOGETHER = 1.0
_STDERR = 2
LEASH = "--leash"
"""Last argument of a process that must end when its standard input ends."""
_was_asked = False
"""Whether a signal has asked this process to end."""
GRACE = 4.0
"""Seconds that a child process may take to end once it is asked to, or its parent has gone."""


def leave_at_interrupt() -> None:
    """Ends the process at once, with status 130 and no traceback, at a Ctrl-C before `on_signals`.

    Programs call it before all other imports, which take seconds and may fail in ways of their own
    when they are interrupted. The first process of a container also ends at SIGTERM, which Linux
    does not deliver to it without a handler.
    """
    if os.getpid() == 1:
        signal.signal(signal.SIGTERM, lambda number, _: os._exit(128 + number))
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not ignored, as by nohup
        signal.signal(signal.SIGINT, lambda number, _: os._exit(128 + number))


def on_signals(stop: threading.Event) -> None:
    """Sets ``stop`` at the first SIGINT, SIGTERM or SIGHUP; a later one ends the process at once,
    with one sentence.

    Signals that come together count as one, because `timeout` and some terminals send a signal both
    to the process and to its group. SIGHUP, from a terminal that closes, never ends the process at
    once, because nobody is there to be impatient, and neither does a signal after the parent's end.
    Under `nohup`, SIGHUP is ignored.
    """
    from common.process.log_lines import line

    heeded = heeded_signals()
    told = signal_pipe(heeded)

    def heed() -> None:
        global _was_asked
        first: float | None = None
        parent = os.getppid()
        while True:
            number = os.read(told, 1)[0]
            if number not in heeded:
                continue
            _was_asked = True
            now = time.monotonic()
            former, parent = parent, os.getppid()
            if first is None:
                first = now
                stop.set()
            # A signal at the parent's end is Linux's, see `end_with_parent`.
            elif now - first > _TOGETHER and number != signal.SIGHUP and parent == former:
                _say_cut_short(line)
                os._exit(128 + number)

    threading.Thread(target=heed, name="signals", daemon=True).start()


def _say_cut_short(line: Callable[[str, str], str]) -> None:
    """Says that a second signal ends this process, and gives a terminal the cursor back that a
    screen has hidden. It takes no lock and does not wait for a reader, since other threads may
    hang."""
    shown = "\n\x1b[?25h" if os.isatty(_STDERR) else ""
    told = line("ended at once, by a second signal: what was not saved is lost", "warning")
    with suppress(OSError):  # nobody reads it
        if select.select([], [_STDERR], [], 0)[1]:
            os.write(_STDERR, f"{shown}{told}\n".encode())


def heeded_signals() -> list[signal.Signals]:
    """Returns the signals that ask this process to end; under `nohup`, SIGHUP is not among them."""
    hangs_up = signal.getsignal(signal.SIGHUP) != signal.SIG_IGN
    return [signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hangs_up else [])]


def signal_pipe(numbers: Iterable[signal.Signals]) -> int:
    """Returns a file descriptor that gives the number of each of these signals, as a byte, when the
    signal comes. It also gives other signals for which a library has installed a Python handler.

    A Python handler alone would not do. It runs only between instructions of the main thread, so a
    signal that comes just before a system call, or in another thread, waits until that returns.
    """
    told, tell = os.pipe()
    os.set_blocking(tell, False)
    signal.set_wakeup_fd(tell, warn_on_full_buffer=False)
    for number in numbers:
        signal.signal(number, lambda number, frame: None)
    return told


def leave_on_leash() -> None:
    """Calls `leave_with_parent` if the command line ends with ``--leash``, and removes the flag.

    Programs call it before all other imports, during which an orphan would occupy a core.
    """
    if sys.argv[-1] == LEASH:
        sys.argv.pop()
        leave_with_parent()


def leave_with_parent() -> None:
    """Sends this process SIGTERM when standard input ends, and ends it if it does not end itself.

    The parent holds the other end of that pipe. However the parent dies, even by kill -9, the
    system closes the pipe, so no orphan is left.
    """

    def watch() -> None:
        while os.read(sys.stdin.fileno(), 1024):
            pass
        if not _was_asked:  # a second signal would be taken for a person's impatience
            os.kill(os.getpid(), signal.SIGTERM)
        threading.Event().wait(GRACE)
        os._exit(1)

    threading.Thread(target=watch, name="leash", daemon=True).start()
