"""Draws pictures as pixels in terminals that support it: by kitty's protocol, or as sixels.

The terminal is asked for its abilities, and pictures stay half blocks until it has answered. Most
terminals have no graphics, and some never answer. Chafa encodes sixels
(``pip install 'ale-robot[graphics]'``); kitty's protocol
(https://sw.kovidgoyal.net/kitty/graphics-protocol) takes a PNG as it is.
"""

import base64
import re
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

_KITTY_QUERY = 31
"""Number of the picture in the question to kitty, which its answer repeats."""
QUESTIONS = (
    f"\x1b_Gi={_KITTY_QUERY},s=1,v=1,a=q,t=d,f=24;AAAA\x1b\\"  # are there graphics as kitty's?
    "\x1b[16t"  # how large is a cell? xterm does not say, but its driver does
    "\x1b[?1;1;0S"  # how many colours have sixels?
    "\x1b[c"  # are there sixels? All terminals answer this.
)
"""Questions to write to a terminal; its answers tell what it can show."""
_ANSWERS = {
    "kitty": re.compile(rb"\x1b_Gi=%d;OK\x1b\\" % _KITTY_QUERY),
    "cell": re.compile(rb"\x1b\[6;(\d{1,3});(\d{1,3})t"),
    "colours": re.compile(rb"\x1b\[\?1;0;(\d{1,9})S"),
    "attributes": re.compile(rb"\x1b\[\?([\d;]{1,99})c"),
}
_SIXEL = b"4"
"""The attribute of terminals with sixels."""
_SIXEL_HEIGHT = 6
_COLOURS = 256
"""Number of colours in a picture; a terminal with fewer would show wrong ones."""
_LONGEST = 256
"""Maximum length of an answer, bytes; the last bytes are kept, as an answer may come in parts."""
_LEAST_CELL = 4
"""Minimum width and height of a plausible cell, pixels."""
_CHUNK = 4_096
"""Maximum number of characters of a picture that kitty takes at once."""


@dataclass(frozen=True)
class Graphics:
    """How to draw pictures into a terminal."""

    kind: Literal["kitty", "sixel"]
    cell: tuple[int, int]
    """Width and height of a character's cell, pixels."""

    def draw(self, picture: NDArray[np.uint8], column: int, row: int, number: int) -> str:
        """Returns what to write to show ``picture uint8 [height, width, 3]``.

        Args:
            column: column of its top left cell, from 1.
            row: row of that cell, from 1.
            number: number of the picture; a later one with the same number replaces it.
        """
        text = _kitty(picture, number) if self.kind == "kitty" else self._sixels(picture)
        return f"\x1b7\x1b[{row};{column}H{text}\x1b8"

    def _sixels(self, picture: NDArray[np.uint8]) -> str:
        import chafa

        # A canvas of one character for each sixel, so that nothing is scaled.
        picture = np.pad(picture, ((0, -len(picture) % _SIXEL_HEIGHT), (0, 0), (0, 0)))
        height, width = picture.shape[:2]
        config = chafa.CanvasConfig()
        config.pixel_mode = chafa.PixelMode.CHAFA_PIXEL_MODE_SIXELS
        config.cell_width, config.cell_height = 1, _SIXEL_HEIGHT
        config.width, config.height = width, height // _SIXEL_HEIGHT
        canvas = chafa.Canvas(config)
        rgb = chafa.PixelType.CHAFA_PIXEL_RGB8
        canvas.draw_all_pixels(rgb, picture.tobytes(), width, height, 3 * width)
        encoded: bytes = canvas.print(fallback=True)  # whatever TERM says
        return encoded.decode("ascii")


def _kitty(picture: NDArray[np.uint8], number: int) -> str:
    _, png = cv2.imencode(".png", picture[:, :, ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1])
    data = base64.b64encode(png.tobytes()).decode()
    chunks = [data[at : at + _CHUNK] for at in range(0, len(data), _CHUNK)]
    # The cursor stays (C), and nothing is answered (q).
    head = f"a=T,f=100,i={number},p=1,C=1,q=2,"
    return "".join(
        f"\x1b_G{'' if index else head}m={int(index + 1 < len(chunks))};{chunk}\x1b\\"
        for index, chunk in enumerate(chunks)
    )


class GraphicsAnswers:
    """Collects a terminal's answers to `QUESTIONS`, which may come in parts, and among keys."""

    def __init__(self) -> None:
        self._found: dict[str, re.Match[bytes]] = {}
        self._last = b""

    def feed(self, sent: bytes) -> None:
        """Takes what the terminal sent."""
        told = self._last + sent
        self._found |= {name: match for name, it in _ANSWERS.items() if (match := it.search(told))}
        self._last = told[-_LONGEST:]

    def graphics(self, cell: tuple[int, int] | None) -> Graphics | None:
        """Returns how the terminal shows pictures; None if it cannot, or has not answered yet.

        Args:
            cell: width and height of a character's cell, pixels, if the driver knows them.
        """
        found = self._found
        if cell is None and "cell" in found:
            high, wide = map(int, found["cell"].groups())
            cell = (wide, high)
        if cell is None or min(cell) < _LEAST_CELL or "attributes" not in found:
            return None
        if "kitty" in found:
            return Graphics("kitty", cell)
        few = "colours" in found and int(found["colours"][1]) < _COLOURS
        if few or _SIXEL not in found["attributes"][1].split(b";") or find_spec("chafa") is None:
            return None
        return Graphics("sixel", cell)
