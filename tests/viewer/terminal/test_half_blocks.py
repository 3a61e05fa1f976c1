"""Pictures as text, read back by a small terminal of the test's own."""

import re

import numpy as np
from numpy.typing import NDArray

from viewer.terminal.half_blocks import HalfBlocks

_TOKEN = re.compile(
    r"\x1b\[(?P<row>\d+);(?P<column>\d+)H|\x1b\[38;2;(?P<over>[\d;]+?);48;2;(?P<under>[\d;]+)m"
    r"|\x1b\[0m|\x1b\[2J|(?P<block>▀)"
)


class Screen:
    """Two pixels in each cell, as a terminal would show them."""

    def __init__(self, columns: int, rows: int) -> None:
        self.pixels = np.zeros((2 * rows, columns, 3), np.uint8)
        self.cells = 0
        self._row = self._column = 0

    def take(self, text: str) -> None:
        position = 0
        while position < len(text):
            match = _TOKEN.match(text, position)
            assert match, repr(text[position : position + 20])
            position = match.end()
            if match["row"]:
                self._row, self._column = int(match["row"]) - 1, int(match["column"]) - 1
            elif match["over"]:
                self._over = [int(number) for number in match["over"].split(";")]
                self._under = [int(number) for number in match["under"].split(";")]
            elif match["block"]:
                self.pixels[2 * self._row, self._column] = self._over
                self.pixels[2 * self._row + 1, self._column] = self._under
                self._column += 1
                self.cells += 1


def noise(height: int, width: int) -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(0, 256, (height, width, 3), np.uint8)


def test_each_cell_shows_two_pixels() -> None:
    picture = noise(8, 6)
    screen = Screen(6, 4)
    screen.take(HalfBlocks().draw(picture, 6, 4))
    np.testing.assert_array_equal(screen.pixels, picture)


def test_only_what_changed_is_sent_again() -> None:
    picture = noise(8, 6)
    blocks, screen = HalfBlocks(), Screen(6, 4)
    screen.take(blocks.draw(picture, 6, 4))
    assert blocks.draw(picture, 6, 4) == ""
    changed = picture.copy()
    changed[5, 3] ^= 255
    changed[7, 4:6] ^= 255
    screen.cells = 0
    screen.take(blocks.draw(changed, 6, 4))
    assert screen.cells == 3
    np.testing.assert_array_equal(screen.pixels, changed)


def test_a_picture_keeps_its_shape() -> None:
    """20 × 20 cells are 20 × 40 squares: twice as wide as high leaves 15 rows above and below."""
    screen = Screen(20, 20)
    screen.take(HalfBlocks().draw(np.full((50, 100, 3), 200, np.uint8), 20, 20))
    lit = screen.pixels[:, :, 0] == 200
    assert lit[15:25].all()
    assert not lit[:15].any()
    assert not lit[25:].any()


def test_a_picture_may_be_stretched() -> None:
    screen = Screen(20, 20)
    screen.take(HalfBlocks().draw(np.full((50, 100, 3), 200, np.uint8), 20, 20, aspect=1.0))
    assert (screen.pixels[:, :, 0] == 200).sum() == 20 * 20
