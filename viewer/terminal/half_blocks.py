"""Pictures as text: each character cell is an upper half block, two pixels one above the other.

Only the cells that changed are sent: in 24-bit colours a cell takes some 40 bytes, which counts if
the terminal is on the other side of a network.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

_HALF = "▀"
_PLAIN = "\x1b[0m"
_CLEAR = "\x1b[0m\x1b[2J"


class HalfBlocks:
    """Draws pictures into the terminal, starting at its top left cell."""

    def __init__(self) -> None:
        self._drawn = np.empty((0, 0, 6), np.int16)

    def draw(
        self, picture: NDArray[np.uint8], columns: int, rows: int, *, aspect: float | None = None
    ) -> str:
        """Returns what to write to show ``picture uint8 [height, width, 3]`` in the rectangle.

        The picture keeps its shape, or is drawn ``aspect`` times as wide as high; the rest of the
        rectangle is black. If the rectangle's size changes, the terminal is cleared first.
        """
        clear = ""
        if self._drawn.shape[:2] != (rows, columns):
            self._drawn, clear = np.full((rows, columns, 6), -1, np.int16), _CLEAR
        height, width = picture.shape[:2]
        aspect = aspect or width / height
        # A character cell is about twice as high as wide, so half a cell is a square.
        wide = min(columns, round(2 * rows * aspect))
        high = min(2 * rows, round(columns / aspect))
        small = cv2.resize(picture, (max(wide, 1), max(high, 1)), interpolation=cv2.INTER_AREA)
        canvas = np.zeros((2 * rows, columns, 3), np.uint8)
        top, left = (2 * rows - small.shape[0]) // 2, (columns - small.shape[1]) // 2
        canvas[top : top + small.shape[0], left : left + small.shape[1]] = small
        cells = np.concatenate((canvas[0::2], canvas[1::2]), axis=2).astype(np.int16)
        return clear + self._send(cells)

    def _send(self, cells: NDArray[np.int16]) -> str:
        changed = (cells != self._drawn).any(axis=2)
        self._drawn = cells
        parts: list[str] = []
        for row in np.flatnonzero(changed.any(axis=1)).tolist():
            colours: list[int] = []
            cursor = -1  # the column that the terminal would write next
            for column in np.flatnonzero(changed[row]).tolist():
                if column != cursor:
                    parts.append(f"\x1b[{row + 1};{column + 1}H")
                wanted = cells[row, column].tolist()
                if wanted != colours:
                    r, g, b, under_r, under_g, under_b = colours = wanted
                    parts.append(f"\x1b[38;2;{r};{g};{b};48;2;{under_r};{under_g};{under_b}m")
                parts.append(_HALF)
                cursor = column + 1
            parts.append(_PLAIN)
        return "".join(parts)
