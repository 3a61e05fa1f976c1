"""A live picture in the terminal, for environments that are rendered for people.

There is no window system behind a headless OpenCV, but most terminals show 24-bit colours.
"""

import atexit
import sys
import time

import numpy as np
from numpy.typing import NDArray

from viewer.terminal.half_blocks import HalfBlocks
from viewer.terminal.terminal import size_of, write_all

_PRINT_ROWS = 4
"""Rows below the picture, in which scrolls what else is printed."""


class TerminalWindow:
    """Shows pictures at the terminal's top, ``rate`` a second; as they come if it is infinite."""

    def __init__(self, rate: float) -> None:
        self._period = 1 / rate
        self._due = 0.0
        self._size = (0, 0)
        self._blocks: HalfBlocks

    def show(self, picture: NDArray[np.uint8], aspect: float | None = None) -> None:
        """Wait until the next picture is due and show it, ``aspect`` times as wide as high."""
        sys.stdout.flush()
        out = sys.stdout.fileno()
        text = ""
        if (size := size_of(out)) != self._size:
            text = self._open(size)
        # A picture that is late is not made up for.
        now = time.monotonic()
        time.sleep(max(self._due - now, 0.0))
        self._due = max(self._due, now) + self._period
        # The cursor stays where others print.
        drawn = self._blocks.draw(picture, size[0], self._high, aspect=aspect)
        write_all(out, f"{text}\x1b7{drawn}\x1b8")

    def _open(self, size: tuple[int, int]) -> str:
        if self._size == (0, 0):
            atexit.register(self.close)
        self._size, self._blocks = size, HalfBlocks()
        # Only the rows below the picture scroll; the cursor goes there.
        below = min(self._high + 1, size[1])
        return f"\x1b[{below};{size[1]}r\x1b[{below};1H"

    @property
    def _high(self) -> int:
        """Rows of the picture."""
        return max(self._size[1] - _PRINT_ROWS, 1)

    def close(self) -> None:
        """Let the whole terminal scroll again; closing twice does no harm."""
        if self._size != (0, 0):
            write_all(sys.stdout.fileno(), f"\x1b[0m\x1b[r\x1b[{self._size[1]};1H\n")
            self._size = (0, 0)
            atexit.unregister(self.close)
