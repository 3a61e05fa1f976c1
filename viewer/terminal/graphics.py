"""Pictures as pixels, where the terminal has them: by kitty's protocol, or as sixels.

The terminal is asked what it can, and pictures stay half blocks until it has answered; most
terminals have no graphics, and some never answer. Sixels are encoded by Chafa
(``pip install 'ale-robot[graphics]'``), and the protocol of kitty
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
"""Number by which the terminal repeats which picture it was asked about."""
QUESTIONS = (
    f"\x1b_Gi={_KITTY_QUERY},s=1,v=1,a=q,t=d,f=24;AAAA\x1b\\"  # are there graphics as kitty's?
    "\x1b[16t"  # how large is a cell? xterm does not say, but its driver does
    "\x1b[?1;1;0S"  # how many colours have sixels?
    "\x1b[c"  # are there sixels? All terminals answer this.
)
"""What to write to a terminal, so that it answers what it can show."""
_ANSWERS = {
    "kitty": re.compile(rb"\x1b_Gi=%d;OK\x1b\\" % _KITTY_QUERY),
    "cell": re.compile(rb"\x1b\[6;(\d{1,3});(\d{1,3})t"),
    "colours": re.compile(rb"\x1b\[\?1;0;(\d{1,9})S"),
    "attributes": re.compile(rb"\x1b\[\?([\d;]{1,99})c"),
}
_SIXEL = b"4"
"""Among a terminal's attributes."""
_SIXEL_HEIGHT = 6
_COLOURS = 256
"""Those of a picture: a terminal with fewer would show others."""
_LONGEST = 256
"""Bytes of an answer, of which the first may have come before the others."""
_LEAST_CELL = 4
"""Pixels: a smaller one is none."""
_CHUNK = 4_096
"""Most characters of a picture that kitty takes at once."""


@dataclass(frozen=True)
class Graphics:
    """How to draw pictures into a terminal."""

    kind: Literal["kitty", "sixel"]
    cell: tuple[int, int]
    """Width and height of a character's cell, pixels."""

    def draw(self, picture: NDArray[np.uint8], column: int, row: int, number: int) -> str:
        """Returns what to write so that ``picture uint8 [height, width, 3]`` is there.

        Args:
            column: of the cell at its top left, from 1, as ``row`` is.
            number: of the picture; a later one with the same number takes its place.
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
    """What a terminal answered to `QUESTIONS`; it may come in parts, and among keys."""

    def __init__(self) -> None:
        self._found: dict[str, re.Match[bytes]] = {}
        self._last = b""

    def feed(self, sent: bytes) -> None:
        """Take what the terminal sent."""
        told = self._last + sent
        self._found |= {name: match for name, it in _ANSWERS.items() if (match := it.search(told))}
        self._last = told[-_LONGEST:]

    def graphics(self, cell: tuple[int, int] | None) -> Graphics | None:
        """Returns how it shows pictures; None for as long as that is not known.

        Args:
            cell: width and height of a character's cell, pixels, if its driver tells.
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
