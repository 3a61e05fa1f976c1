"""Standard output that nobody can read: its reader has gone, or the disk is full."""

import os
import select
from typing import TextIO


def has_reader(stream: TextIO) -> bool:
    """Returns False where ``stream`` is a pipe or socket whose other end is closed."""
    poll = select.poll()
    try:
        poll.register(stream, 0)
    except (OSError, ValueError):
        return True  # in memory, or closed
    return not poll.poll(0)


def silence(stream: TextIO) -> None:
    """Let what is still buffered go nowhere, or the interpreter's last flush would fail."""
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
    except (OSError, ValueError):
        return
