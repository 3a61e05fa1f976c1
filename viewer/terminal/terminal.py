"""The terminal as a screen and a keyboard, which is always given back as it was."""

import fcntl
import os
import select
import struct
import sys
import termios
from typing import Any, Self

from rich.console import Console

from common.errors import InputError

# Switch to the alternate screen, hide the cursor, and clear. Then, by kitty's protocol, which other
# terminals ignore: report releases of arrow keys, and answer whether this is supported.
_OPEN = "\x1b[?1049h\x1b[?25l\x1b[2J\x1b[?1004h\x1b[>2u\x1b[?u"
_CLOSE = "\x1b[<u\x1b[?1004l\x1b[0m\x1b[?25h\x1b[?1049l"


def size_of(descriptor: int) -> tuple[int, int]:
    """Returns columns and rows of the terminal behind a file descriptor."""
    try:
        columns, rows = os.get_terminal_size(descriptor)
    except OSError:
        columns, rows = 0, 0
    # A terminal that does not know its size says 0.
    return (columns, rows) if columns and rows else (80, 24)


def cell_of(descriptor: int) -> tuple[int, int] | None:
    """Returns width and height of a character's cell, pixels; None if they are unknown."""
    try:
        told = fcntl.ioctl(descriptor, termios.TIOCGWINSZ, bytes(8))
    except OSError:
        return None
    rows, columns, width, height = struct.unpack("HHHH", told)
    return (width // columns, height // rows) if rows and columns and width and height else None


def write_all(descriptor: int, text: str) -> None:
    """Writes ``text`` to a file descriptor, however slow the reader is.

    Characters that cannot be encoded, as in file names that are not UTF-8, are escaped.
    """
    left = memoryview(text.encode(errors="backslashreplace"))
    while left:
        try:
            left = left[os.write(descriptor, left) :]
        except BlockingIOError:
            select.select([], [descriptor], [])


def check_terminal(least: tuple[int, int]) -> None:
    """Raises InputError if standard input and output are not a terminal, if it says that it cannot
    draw, or if it has fewer columns or rows than ``least``."""
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise InputError("pictures and keys need a terminal: run this command in one.")
    if Console().is_dumb_terminal:
        raise InputError(
            f"a terminal of TERM={os.environ['TERM']} draws no pictures: use another, or "
            "`ale-robot film`."
        )
    size = size_of(sys.stdout.fileno())
    if any(have < wanted for have, wanted in zip(size, least, strict=True)):
        have, wanted = (" × ".join(map(str, each)) for each in (size, least))
        raise InputError(f"the terminal has {have} characters: make it {wanted} or larger.")


class Terminal:
    """Takes over the terminal: pictures out on standard output, keys in from standard input.

    A context manager. Ctrl-C still interrupts. Ctrl-Z does nothing, because the shell would get the
    terminal in its present state. The constructor raises InputError as `check_terminal` does.
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
        try:
            termios.tcsetattr(self._in, termios.TCSADRAIN, state)
        except termios.error as error:  # a signal, while it was in the background
            raise InputError(
                f"the terminal cannot be taken over ({error}): run this in the foreground."
            ) from None
        self.write(_OPEN)
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self.write(_CLOSE)
        finally:
            # Flush: keys that were pressed in the meantime are not for the shell.
            termios.tcsetattr(self._in, termios.TCSAFLUSH, self._before)

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows of the terminal."""
        return size_of(self._out)

    @property
    def cell(self) -> tuple[int, int] | None:
        """Width and height of a character's cell, pixels; None if they are unknown."""
        return cell_of(self._out)

    def write(self, text: str) -> None:
        """Writes all of ``text``, however slow the terminal is."""
        write_all(self._out, text)

    def keys(self) -> bytes:
        """Returns what has been typed since the last call, without waiting; empty also at the end
        of input."""
        ready, _, _ = select.select([self._in], [], [], 0.0)
        return os.read(self._in, 1024) if ready else b""
