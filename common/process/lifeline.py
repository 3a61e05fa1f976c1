"""How a process learns that it should end: by a signal, or because its parent is gone."""

import _thread
import os
import signal
import sys
import threading
import time
from types import FrameType

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
    may also fail in ways of its own.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not ignored, as by nohup
        signal.signal(signal.SIGINT, lambda number, _: os._exit(128 + number))


def on_signals(stop: threading.Event) -> None:
    """Set ``stop`` at the first SIGINT, SIGTERM or SIGHUP; a later one ends the process at once.

    Those that come together are one: `timeout` and some terminals send a signal both to the
    process and to its group. A terminal that closes (SIGHUP) ends nothing at once, for nobody is
    there to be impatient, and nothing at all under `nohup`.
    """
    first: float | None = None

    def handle(number: int, frame: FrameType | None) -> None:
        nonlocal first
        global _was_asked
        _was_asked = True
        now = time.monotonic()
        if first is None:
            first = now
        elif now - first > _TOGETHER and number != signal.SIGHUP:
            os._exit(128 + number)
        # In another thread: this one may hold the event's lock, in a wait that was interrupted.
        _thread.start_new_thread(stop.set, ())

    signal.signal(signal.SIGINT, handle)
    signal.signal(signal.SIGTERM, handle)
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        signal.signal(signal.SIGHUP, handle)


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
