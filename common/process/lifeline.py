"""How a process learns that it should end: by a signal, or because its parent is gone."""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterable

_TOGETHER = 1.0
LEASH = "--leash"
"""Last argument of a process that is to leave when its standard input ends."""
_was_asked = False
"""Whether a signal has asked this process to leave."""
GRACE = 4.0
"""Seconds that a child process may take to leave once it is asked to, or its parent is gone."""


def leave_at_interrupt() -> None:
    """End the process at once, with status 130 and no traceback, at a Ctrl-C before `on_signals`.

    Programs call it before they import all else, which takes seconds. A module that is interrupted
    may also fail in ways of its own. The first process of a container ends at SIGTERM too, which
    Linux keeps from one that has no handler of it.
    """
    if os.getpid() == 1:
        signal.signal(signal.SIGTERM, lambda number, _: os._exit(128 + number))
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not ignored, as by nohup
        signal.signal(signal.SIGINT, lambda number, _: os._exit(128 + number))


def on_signals(stop: threading.Event) -> None:
    """Set ``stop`` at the first SIGINT, SIGTERM or SIGHUP; a later one ends the process at once.

    Those that come together are one: `timeout` and some terminals send a signal both to the
    process and to its group. A terminal that closes (SIGHUP) ends nothing at once, for nobody is
    there to be impatient, and nothing at all under `nohup`.
    """
    heeded = heeded_signals()
    told = signal_pipe(heeded)

    def heed() -> None:
        global _was_asked
        first: float | None = None
        while True:
            number = os.read(told, 1)[0]
            if number not in heeded:
                continue
            _was_asked = True
            now = time.monotonic()
            if first is None:
                first = now
                stop.set()
            elif now - first > _TOGETHER and number != signal.SIGHUP:
                os._exit(128 + number)

    threading.Thread(target=heed, name="signals", daemon=True).start()


def heeded_signals() -> list[signal.Signals]:
    """Returns the signals that ask this process to end: without SIGHUP under `nohup`."""
    hangs_up = signal.getsignal(signal.SIGHUP) != signal.SIG_IGN
    return [signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hangs_up else [])]


def signal_pipe(numbers: Iterable[signal.Signals]) -> int:
    """Returns a file descriptor from which the number of each of these signals can be read, a byte,
    once it has come; and of any other for which a library has a handler of Python's.

    A handler of Python's would not do: it runs only between instructions of the main thread, so
    a signal that comes just before a system call, or in another thread, waits as long as that.
    """
    told, tell = os.pipe()
    os.set_blocking(tell, False)
    signal.set_wakeup_fd(tell, warn_on_full_buffer=False)
    for number in numbers:
        signal.signal(number, lambda number, frame: None)
    return told


def leave_on_leash() -> None:
    """As `leave_with_parent` where ``--leash`` ends the command line, from which it is taken.

    Programs call it before they import all else: until then an orphan would hold a core.
    """
    if sys.argv[-1] == LEASH:
        sys.argv.pop()
        leave_with_parent()


def leave_with_parent() -> None:
    """Send this process SIGTERM when standard input ends; end it if it does not leave by itself.

    The parent holds the other end of that pipe; however it dies, kill -9 included, the system
    closes it, so no orphan is left.
    """

    def watch() -> None:
        while os.read(sys.stdin.fileno(), 1024):
            pass
        if not _was_asked:  # else this would be the signal of an impatient person
            os.kill(os.getpid(), signal.SIGTERM)
        threading.Event().wait(GRACE)
        os._exit(1)

    threading.Thread(target=watch, name="leash", daemon=True).start()
