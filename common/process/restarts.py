"""``--restart``: a process that does its work in a child, and starts it again when it dies.

The child is a fork, made before there are threads or sessions, so it need not import anything anew.
"""

import _thread
import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from types import FrameType

from common.errors import exit_on_input_error
from common.process.exit_codes import EXIT_CODES, NO_ROOM
from common.process.log_lines import line

_FIRST_PAUSE, _LONGEST_PAUSE = 1.0, 60.0
_SETTLED = 600.0
"""Seconds of work after which earlier ends are forgotten."""
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_IN_VAIN = {code.number for code in EXIT_CODES if not code.again}
_PR_SET_PDEATHSIG = 1
_prctl = ctypes.CDLL(None).prctl


def with_restarts(name: str, work: Callable[[bool], int | None], most: int) -> int | None:
    """Does ``work`` in a child process, and again where it fails; returns its last exit code.

    Pauses between restarts grow. A full disk is waited for without a limit. Work is not done again
    after a status that says that this is in vain, nor once this process was asked to end: signals
    are handed on. A child that loses this process ends as by SIGTERM.

    Args:
        name: how people know the process.
        work: what it does; its argument is whether it was begun before.
        most: restarts in a row; 0 for none, where ``work`` is done in this process.
    """
    if not most:
        return work(False)
    stop = threading.Event()
    child = asked = 0

    def hand_on(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        asked = number
        if child:
            os.kill(child, number)
        # Not here: the wait below, which this interrupts, may hold the lock of the event.
        _thread.start_new_thread(stop.set, ())

    for number in _SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, hand_on)
    starts, restarts, parent, told = 0, 0, os.getpid(), 0
    while True:
        began = time.monotonic()
        sys.stdout.flush()  # or the child would say it too
        signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
        if asked:
            return told or 128 + asked
        child = os.fork()
        if not child:
            _be_child(parent, partial(work, starts > 0))
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
        os.waitid(os.P_PID, child, os.WEXITED | os.WNOWAIT)
        ended, child = child, 0  # from here on its number may be another process'
        status = os.waitstatus_to_exitcode(os.waitpid(ended, 0)[1])
        worked = time.monotonic() - began
        told = status if status >= 0 else 128 - status
        if asked or status in _IN_VAIN or status > 128:
            return told
        if worked > _SETTLED:
            starts, restarts = 0, 0
        starts += 1
        restarts += status != NO_ROOM
        how = f"status {status}" if status > 0 else f"signal {-status}"
        if restarts > most:
            _say(f"{name} ended by {how} after {worked:.0f} s, and {most} restarts were in vain.")
            return told
        pause = min(_FIRST_PAUSE * 2 ** (starts - 1), _LONGEST_PAUSE)
        which = "another try" if status == NO_ROOM else f"restart {restarts} of {most}"
        _say(f"{name} ended by {how} after {worked:.0f} s: {which} in {pause:.0f} s.")
        if stop.wait(pause):
            return told


def end_with_parent() -> None:
    """In a child that was just forked: lets Linux end it as by SIGTERM once its parent is gone,
    however that ends."""
    _prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _be_child(parent: int, work: Callable[[], int | None]) -> None:
    """Does ``work`` and ends this process."""
    for number in _SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, lambda number, _: os._exit(128 + number))
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
    end_with_parent()
    if os.getppid() != parent:
        os._exit(128 + signal.SIGTERM)
    exit_on_input_error(work)


def _say(sentence: str) -> None:
    print(line(sentence, "warning"), file=sys.stderr, flush=True)
