"""Standard output that cannot be written as it is: its reader has gone, the disk is full, or a text
has no encoding."""

import os
import select
from io import TextIOWrapper
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


def escape(stream: TextIO) -> None:
    """Let what has no encoding, such as the name of a file that is not UTF-8, be escaped."""
    if isinstance(stream, TextIOWrapper):
        stream.reconfigure(errors="backslashreplace")
