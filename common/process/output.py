"""Standard output that cannot be written as it is: its reader has gone, the disk is full, or a text
has no encoding."""

import os
import select
import shutil
import sys
from io import TextIOWrapper
from typing import TextIO

_LAST_STREAM = 2
"""Number of standard error."""
_LEAST_COLUMNS, _USUAL_COLUMNS = 20, 80


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


def open_closed() -> None:
    """Let those of the standard streams lead nowhere that were closed when this process began.

    Python has none in their place, and whatever file is opened next would take their number, and
    get what a library prints.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= _LAST_STREAM:
        os.set_inheritable(number, True)
    os.close(number)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115


def escape(stream: TextIO) -> None:
    """Let what has no encoding, such as the name of a file that is not UTF-8, be escaped."""
    if isinstance(stream, TextIOWrapper):
        stream.reconfigure(errors="backslashreplace")


def widen() -> None:
    """Let a terminal that tells of next to no columns have some: in three of them a help never
    comes to its end, and in none a table is empty."""
    told = os.environ.get("COLUMNS", "")
    columns = int(told) if told.isdecimal() else shutil.get_terminal_size().columns
    if columns < _LEAST_COLUMNS:
        os.environ["COLUMNS"] = str(_USUAL_COLUMNS)
