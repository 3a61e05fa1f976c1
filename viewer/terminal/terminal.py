"""The terminal as a screen and a keyboard, given back as it was however the block is left."""

import fcntl
import os
import select
import struct
import sys
import termios
from typing import Any, Self

from common.errors import InputError

# The other screen, no cursor, nothing on it; and, where the terminal knows how (the protocol of
# kitty, which others ignore), tell when arrow keys are let go, and whether it will.
_OPEN = "\x1b[?1049h\x1b[?25l\x1b[2J\x1b[>2u\x1b[?u"
_CLOSE = "\x1b[<u\x1b[0m\x1b[?25h\x1b[?1049l"


def size_of(descriptor: int) -> tuple[int, int]:
    """Columns and rows of the terminal behind a file descriptor."""
    try:
        columns, rows = os.get_terminal_size(descriptor)
    except OSError:
        columns, rows = 0, 0
    # A terminal that does not know its size says 0.
    return (columns, rows) if columns and rows else (80, 24)


def cell_of(descriptor: int) -> tuple[int, int] | None:
    """Width and height of a character's cell, pixels; None where the terminal does not tell."""
    try:
        told = fcntl.ioctl(descriptor, termios.TIOCGWINSZ, bytes(8))
    except OSError:
        return None
    rows, columns, width, height = struct.unpack("HHHH", told)
    return (width // columns, height // rows) if rows and columns and width and height else None


def write_all(descriptor: int, text: str) -> None:
    """Write ``text`` to a file descriptor, however slowly it is taken.

    What has no encoding, such as the name of a file that is not UTF-8, is escaped.
    """
    left = memoryview(text.encode(errors="backslashreplace"))
    while left:
        try:
            left = left[os.write(descriptor, left) :]
        except BlockingIOError:
            select.select([], [descriptor], [])


def check_terminal(least: tuple[int, int]) -> None:
    """Refuses standard input and output that are no terminal, or one that has fewer columns or rows
    than ``least``. Raises InputError."""
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise InputError("picture and keys need a terminal: run it in one.")
    size = size_of(sys.stdout.fileno())
    if any(have < wanted for have, wanted in zip(size, least, strict=True)):
        have, wanted = (" × ".join(map(str, each)) for each in (size, least))
        raise InputError(f"the terminal has {have} characters: make it {wanted} or larger.")


class Terminal:
    """Takes over the terminal: pictures out on standard output, keys in from standard input.

    A context manager. Ctrl-C still interrupts; Ctrl-Z does nothing, for it would leave the terminal
    to the shell in the state that it is in here. Raises InputError at its beginning, as
    `check_terminal` does.
    """

    def __init__(self, least: tuple[int, int]) -> None:
        check_terminal(least)
        self._out = sys.stdout.fileno()
        self._in = sys.stdin.fileno()

    def __enter__(self) -> Self:
        self._before: list[Any] = termios.tcgetattr(self._in)
        state = termios.tcgetattr(self._in)
        state[3] &= ~(termios.ICANON | termios.ECHO)
        state[6][termios.VSUSP] = os.fpathconf(self._in, "PC_VDISABLE").to_bytes()
        termios.tcsetattr(self._in, termios.TCSADRAIN, state)
        self.write(_OPEN)
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self.write(_CLOSE)
        finally:
            # Keys that were pressed meanwhile are not for the shell.
            termios.tcsetattr(self._in, termios.TCSAFLUSH, self._before)

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows."""
        return size_of(self._out)

    @property
    def cell(self) -> tuple[int, int] | None:
        """Width and height of a character's cell, pixels, if it tells."""
        return cell_of(self._out)

    def write(self, text: str) -> None:
        """Write all of ``text``, however slowly it is taken."""
        write_all(self._out, text)

    def keys(self) -> bytes:
        """What has been typed since the last call, at once; empty at the end of input too."""
        ready, _, _ = select.select([self._in], [], [], 0.0)
        return os.read(self._in, 1024) if ready else b""
