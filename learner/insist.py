"""`insist`: lets a run wait for a disk that is full or read-only for a while."""

import threading
import time
from collections.abc import Callable
from typing import TypeVar

from common.errors import NO_ROOM_ERRORS
from common.process.service_manager import alive
from common.schedule import Every, Now

_POLL = 0.1
_REMINDER_SECONDS = 60.0
T = TypeVar("T")


def insist(
    write: Callable[[], T],
    say: Callable[[str], None],
    stop: threading.Event,
    now: Now = time.monotonic,
) -> T:
    """Calls ``write`` until the disk has room, and returns its result.

    Args:
        write: is called until it succeeds; a failed call must not hinder the next one.
        say: takes a sentence for people, at once and then every minute.
        stop: ends the wait.

    Raises:
        OSError: the write failed for another reason, or still failed after ``stop`` was set.
    """
    told, reminder = False, Every(_REMINDER_SECONDS, now)
    while True:
        stopped = stop.is_set()
        try:
            found = write()
            break
        except OSError as error:
            if error.errno not in NO_ROOM_ERRORS or stopped:
                raise
            if reminder.is_due():
                what = error.filename or "a file of the run"
                say(
                    f"WARNING: {what} cannot be written ({error.strerror}): training waits until "
                    "it can."
                )
            told = True
        stop.wait(_POLL)
        alive()
    if told and not stopped:
        say("The disk can be written again: training continues.")
    return found
