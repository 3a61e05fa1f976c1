"""``--restart``: a process that does its work in a child, and restarts the child when it dies.

The child is a fork, made before there are threads or sessions, so it need not import anything
again.
"""

import ctypes
import os
import select
import signal
import sys
import time
from collections.abc import Callable, Collection
from functools import partial

from common.exit_codes import FINAL, NO_ROOM
from common.process.backoff import SETTLED, growing_pause
from common.process.lifeline import heeded_signals, signal_pipe
from common.process.log_lines import say_aside, write_line
from common.process.program_end import exit_on_input_error

_PR_SET_PDEATHSIG = 1
_prctl = ctypes.CDLL(None).prctl


def with_restarts(name: str, work: Callable[[bool], int | None], most: int) -> int | None:
    """Does ``work`` in a child process, and again if it fails; returns its last exit code.

    Pauses between restarts grow. If the disk is full, restarts are not limited. There is no restart
    after an exit code that says that it cannot help, nor once this process was asked to end; it
    passes signals on to the child. A child whose parent dies ends as by SIGTERM.

    Args:
        name: the name by which people know the process.
        work: the work; its argument is whether it was begun before.
        most: maximum number of restarts in a row; with 0, ``work`` is done in this process.
    """
    if not most:
        return work(False)
    heeded = heeded_signals()
    told_by = signal_pipe([*heeded, signal.SIGCHLD])
    starts, restarts, parent = 0, 0, os.getpid()
    while True:
        began = time.monotonic()
        sys.stdout.flush()  # or the child would print the buffer too
        signal.pthread_sigmask(signal.SIG_BLOCK, heeded)  # the child's must not use the pipe
        child = os.fork()
        if not child:
            _be_child(parent, heeded, partial(work, starts > 0))
        signal.pthread_sigmask(signal.SIG_UNBLOCK, heeded)
        status, asked = _await(child, told_by, heeded)
        worked = time.monotonic() - began
        told = status if status >= 0 else 128 - status
        if asked or status in FINAL or status > 128:
            return told
        if worked > SETTLED:
            starts, restarts = 0, 0
        starts += 1
        restarts += status != NO_ROOM
        how = f"status {status}" if status > 0 else f"signal {-status}"
        if status < 0 and sys.stderr.isatty():  # it left its screen as it was, without a cursor
            write_line("\x1b[?25h", sys.stderr)
        if restarts > most:
            outcome = f"and {most} restarts did not help"
            say_aside(f"{name} ended by {how} after {worked:.0f} s, {outcome}.", "warning")
            return told
        pause = growing_pause(starts)
        which = "another try" if status == NO_ROOM else f"restart {restarts} of {most}"
        said = f"{name} ended by {how} after {worked:.0f} s: {which} in {pause:.0f} s."
        say_aside(said, "warning")
        if _is_asked_within(pause, told_by, heeded):
            return told


def _await(child: int, told_by: int, heeded: Collection[int]) -> tuple[int, bool]:
    """Waits for the end of ``child``, and passes on to it the signals that the `signal_pipe` gives
    until then. Returns its exit status, negative for a signal, and whether it was asked to end."""
    asked = False
    while True:
        number = os.read(told_by, 1)[0]
        if number in heeded:
            asked = True
            os.kill(child, number)  # not waited for yet, so no other process has its number
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status), asked


def _is_asked_within(seconds: float, told_by: int, heeded: Collection[int]) -> bool:
    """Waits for so many seconds; returns True at once if a signal asks this process to end."""
    end = time.monotonic() + seconds
    while select.select([told_by], [], [], max(end - time.monotonic(), 0.0))[0]:
        if os.read(told_by, 1)[0] in heeded:  # not SIGCHLD of a child that had been stopped
            return True
    return False


def end_with_parent() -> None:
    """Lets Linux send this process, a new fork, SIGTERM once its parent has gone, for whatever
    reason."""
    _prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _be_child(parent: int, heeded: list[signal.Signals], work: Callable[[], int | None]) -> None:
    """Does ``work`` in the forked child, and ends it."""
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    for number in heeded:
        signal.signal(number, lambda number, _: os._exit(128 + number))
    signal.pthread_sigmask(signal.SIG_UNBLOCK, heeded)
    end_with_parent()
    if os.getppid() != parent:
        os._exit(128 + signal.SIGTERM)
    exit_on_input_error(work)
