"""Handles standard output that cannot be written as it is: its reader has gone, the disk is full,
or a text cannot be encoded."""

import os
import select
import shutil
import sys
from contextlib import suppress
from io import TextIOWrapper
from typing import TextIO

_LAST_STREAM = 2
"""Number of standard error."""
_LEAST_COLUMNS, _USUAL_COLUMNS = 20, 80


def has_reader(stream: TextIO) -> bool:
    """Returns False if ``stream`` is a pipe or socket whose other end is closed."""
    poll = select.poll()
    try:
        poll.register(stream, 0)
    except (OSError, ValueError):
        return True  # in memory, or closed
    return not poll.poll(0)


def silence(stream: TextIO) -> None:
    """Discards what is still buffered; otherwise the interpreter's last flush would fail."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def open_closed() -> None:
    """Opens the null device for each standard stream that was closed when this process began.

    Python sets such streams to None. The next file to be opened would take the stream's number, and
    would receive what a library prints.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= _LAST_STREAM:
        os.set_inheritable(number, True)
    os.close(number)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115


def escape(stream: TextIO) -> None:
    """Lets ``stream`` escape what it cannot encode, such as a file name that is not UTF-8."""
    if isinstance(stream, TextIOWrapper):
        stream.reconfigure(errors="backslashreplace")


def visible(text: str) -> str:
    """Returns ``text`` with its control characters escaped, except ends of lines and tabs: a
    stranger's text would otherwise command the terminal."""
    return "".join(c if c.isprintable() or c in "\n\t" else ascii(c)[1:-1] for c in text)


def widen() -> None:
    """Assumes a usual width if the terminal reports next to no columns. With three columns a help
    text never ends, and with none a table is empty."""
    told = os.environ.get("COLUMNS", "")
    columns = int(told) if told.isdecimal() else shutil.get_terminal_size().columns
    if columns < _LEAST_COLUMNS:
        os.environ["COLUMNS"] = str(_USUAL_COLUMNS)
