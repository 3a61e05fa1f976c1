"""Pictures as kitty's graphics and as sixels, read back by decoders of the test's own.

They were also looked at in xterm under a virtual display: ``xterm -ti vt340 -xrm
'XTerm*numColorRegisters: 256' -e ale-robot watch``.
"""

import base64
import re
from itertools import pairwise

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.viewer.person import Person
from viewer.terminal.graphics import Graphics, GraphicsAnswers

CELL = (10, 20)
SIXELS_ANSWERED = b"\x1b[?63;1;2;4;6;9c"
KITTY_ANSWERED = b"\x1b_Gi=31;OK\x1b\\\x1b[?62c"


def picture(high: int, wide: int) -> NDArray[np.uint8]:
    """Colours that change slowly, and a sharp square."""
    y, x = np.mgrid[:high, :wide]
    drawn = np.stack([255 * x // wide, 255 * y // high, 0 * x + 90], axis=2).astype(np.uint8)
    drawn[high // 4 : high // 2, wide // 4 : wide // 2] = (250, 220, 10)
    return drawn


def of_kitty(text: str) -> NDArray[np.uint8]:
    """The picture in the messages of kitty's protocol."""
    found = re.findall(r"\x1b_G([^;]*);([A-Za-z0-9+/=]*)\x1b\\", text)
    assert [keys.rpartition("m=")[2] for keys, _ in found] == ["1"] * (len(found) - 1) + ["0"]
    assert all(len(data) <= 4096 for _, data in found)
    png = base64.b64decode("".join(data for _, data in found))
    read = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert read is not None
    return np.asarray(read[:, :, ::-1])


def of_sixels(text: str) -> NDArray[np.uint8]:
    """The picture in a sequence of sixels (VT340's manual, chapter 14)."""
    match = re.search(r'\x1bP[\d;]*q"1;1;(\d+);(\d+)([^\x1b]*)\x1b\\', text)
    assert match
    wide, high = int(match[1]), int(match[2])
    drawn = np.zeros((high + 6, wide, 3), np.uint8)
    colours: dict[int, list[float]] = {}
    column = band = 0
    colour = -1
    for token in re.finditer(
        r"#(\d+)(?:;2;(\d+);(\d+);(\d+))?|!(\d+)([?-~])|([?-~])|([$-])", match[3]
    ):
        if token[1]:
            colour = int(token[1])
            if token[2]:
                colours[colour] = [int(part) * 2.55 for part in token.groups()[1:4]]
        elif token[8]:
            column, band = 0, band + (token[8] == "-")
        else:
            count, bits = int(token[5] or 1), ord(token[6] or token[7]) - 63
            for bit in range(6):
                if bits >> bit & 1:
                    drawn[6 * band + bit, column : column + count] = np.rint(colours[colour])
            column += count
    return drawn[:high]


def test_kitty_gets_the_picture_as_it_is() -> None:
    shown = picture(90, 130)
    text = Graphics("kitty", CELL).draw(shown, 3, 2, 1)
    assert text.startswith("\x1b7\x1b[2;3H\x1b_Ga=T,f=100,i=1,p=1,")
    np.testing.assert_array_equal(of_kitty(text), shown)
    noise = np.random.default_rng(0).integers(0, 256, (120, 160, 3), np.uint8)
    np.testing.assert_array_equal(of_kitty(Graphics("kitty", CELL).draw(noise, 1, 1, 2)), noise)


def test_sixels_are_the_picture_in_256_colours() -> None:
    pytest.importorskip("chafa")
    shown = picture(95, 135)  # neither whole cells nor whole sixels
    text = Graphics("sixel", CELL).draw(shown, 3, 2, 1)
    assert text.startswith("\x1b7\x1b[2;3H\x1bP")
    seen = of_sixels(text)[:95, :135].astype(int)
    assert abs(seen - shown).mean() < 8
    assert abs(seen[30:40, 40:60] - (250, 220, 10)).max() < 16


@pytest.mark.parametrize(
    ("sent", "cell", "kind"),
    [
        (KITTY_ANSWERED, CELL, "kitty"),
        (b"\x1b[A\x1b[6;20;10t" + KITTY_ANSWERED, None, "kitty"),
        (b"\x1b[?1;0;256S" + SIXELS_ANSWERED, CELL, "sixel"),
        (b"\x1b[6;20;10t\x1b[?1;3S" + SIXELS_ANSWERED, None, "sixel"),
        (b"\x1b[?1;0;16S" + SIXELS_ANSWERED, CELL, None),
        (SIXELS_ANSWERED, None, None),
        (SIXELS_ANSWERED, (0, 0), None),
        (b"\x1b[?64;1;2;6;14c", CELL, None),
        (b"\x1b_Gi=31;ENOTSUP:4\x1b\\\x1b[?62c", CELL, None),
        (b"q 4;c", CELL, None),
    ],
)
def test_what_a_terminal_answers(
    sent: bytes, cell: tuple[int, int] | None, kind: str | None
) -> None:
    if kind == "sixel":
        pytest.importorskip("chafa")
    answers = GraphicsAnswers()
    for start, end in pairwise([*range(0, len(sent), 3), len(sent)]):
        assert answers.graphics(cell) is None
        answers.feed(sent[start:end])
    found = answers.graphics(cell)
    assert found == (None if kind is None else Graphics(kind, CELL))  # type: ignore[arg-type]


def test_keys_held_down_do_not_make_it_forget() -> None:
    answers = GraphicsAnswers()
    answers.feed(KITTY_ANSWERED)
    answers.feed(400 * b"\x1b[1;1:2A")
    assert answers.graphics(CELL) == Graphics("kitty", CELL)


@pytest.mark.usefixtures("forks")
def test_who_watches_sees_pixels_once_the_terminal_has_answered() -> None:
    person = Person("watch", "--env", "ale")
    person.sees(r"\x1b\[c")
    person.sees(r"▀")
    person.types(b"\x1b[6;20;10t" + KITTY_ANSWERED)
    person.sees(r"\x1b_Ga=T,f=100,i=2,[^;]*;[^\x1b]*\x1b\\(\x1b_Gm[^\x1b]*\x1b\\)*\x1b8")
    shown = person.seen.decode(errors="replace")
    of_screen = shown[shown.index("\x1b_Ga=T,f=100,i=1,") : shown.index("\x1b_Ga=T,f=100,i=2,")]
    assert (of_kitty(of_screen) > 200).any()
    person.types(b"q")
    assert person.leaves() == 0
    assert person.has_the_terminal_back()
    person.close()
