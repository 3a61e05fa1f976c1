"""A live picture in the terminal, for environments that are rendered for people.

A headless OpenCV cannot open windows, but most terminals show 24-bit colours.
"""

import atexit
import sys
import time

import numpy as np
from numpy.typing import NDArray

from viewer.terminal.half_blocks import HalfBlocks
from viewer.terminal.terminal import size_of, write_all

_PRINT_ROWS = 4
"""Rows below the picture, in which other output scrolls."""


class TerminalWindow:
    """Shows pictures at the top of the terminal, ``rate`` per second; if that is infinite, as they
    come."""

    def __init__(self, rate: float) -> None:
        self._period = 1 / rate
        self._due = 0.0
        self._size = (0, 0)
        self._blocks: HalfBlocks

    def show(self, picture: NDArray[np.uint8], aspect: float | None = None) -> None:
        """Waits until the next picture is due, and shows it ``aspect`` times as wide as high."""
        sys.stdout.flush()
        out = sys.stdout.fileno()
        text = ""
        if (size := size_of(out)) != self._size:
            text = self._open(size)
        # The pictures after a late one keep the usual pace.
        now = time.monotonic()
        time.sleep(max(self._due - now, 0.0))
        self._due = max(self._due, now) + self._period
        # Save and restore the cursor, which stays where other output goes.
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
        """Lets the whole terminal scroll again; closing twice is harmless."""
        if self._size != (0, 0):
            write_all(sys.stdout.fileno(), f"\x1b[0m\x1b[r\x1b[{self._size[1]};1H\n")
            self._size = (0, 0)
            atexit.unregister(self.close)
