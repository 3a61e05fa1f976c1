"""Views of an actor: what travels unchanged, and what a learner refuses to pass on."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from common.errors import MessageError
from common.protocol.live_view import MAX_PICTURE_BYTES, LiveView, ViewRequest, size_of


def jpeg(width: int, height: int, *flags: int) -> bytes:
    picture = np.random.default_rng(0).integers(0, 256, (height, width, 3), np.uint8)
    return cv2.imencode(".jpg", picture, flags)[1].tobytes()


PICTURE = jpeg(320, 240)
VIEW = LiveView(
    streams=2,
    score=-3.0,
    steps=70,
    found=True,
    explored=False,
    picture=PICTURE,
    border=(0.1, 0.1, 0.9, 0.1, 0.9, 0.9, 0.1, 0.9),
    game=(0.2, 0.2, 0.8, 0.2, 0.8, 0.8, 0.2, 0.8),
    frame=jpeg(84, 84),
    room=b"",
    wanted=16,
    pressed=3,
    actions=(0, 17),
    values=(0.5, -1.25),
    chosen=1,
)


def test_a_view_travels_unchanged() -> None:
    assert LiveView.decode(VIEW.encode()) == VIEW
    asked = ViewRequest(3, "hands")
    assert ViewRequest.decode(asked.encode()) == asked


@pytest.mark.parametrize("flags", [(), (cv2.IMWRITE_JPEG_PROGRESSIVE, 1)])
def test_the_size_is_read_from_the_headers(flags: tuple[int, ...]) -> None:
    assert size_of(jpeg(97, 41, *flags)) == (97, 41)


def grown(picture: bytes) -> bytes:
    """The same picture, which now says that it is 65,535 pixels wide."""
    sizes = (240).to_bytes(2) + (320).to_bytes(2)
    assert picture.count(sizes) == 1
    return picture.replace(sizes, (240).to_bytes(2) + b"\xff\xff")


def hidden(marker: int) -> bytes:
    """A picture of 20,000 pixels a side, and a small one where it ends if ``marker`` has a length
    and what follows is that."""
    size = bytes((0xFF, 0xC0, 0, 11, 8)) + (20_000).to_bytes(2) * 2 + bytes((1, 1, 0x11, 0))
    start = bytes((0xFF, 0xD8, 0xFF, marker)) + size
    return start.ljust(4 + int.from_bytes(start[4:6]), b"\0") + PICTURE[2:]


@pytest.mark.parametrize("marker", [0x00, 0x01, 0xD0, 0xD7, 0xD9, 0xFF])
def test_no_size_is_hidden_behind_a_marker_that_has_no_length(marker: int) -> None:
    with pytest.raises(MessageError, match="should be a JPEG"):
        size_of(hidden(marker))


@pytest.mark.parametrize(
    "wrong",
    [
        {"picture": b"<svg onload='alert(1)'/>"},
        {"picture": PICTURE[:2]},
        {"picture": PICTURE[:20]},
        {"picture": PICTURE[:2] + PICTURE},
        {"picture": b"\xff\xd8" + b"\xff\xe0\0\0" * 1_000},
        {"picture": PICTURE + bytes(MAX_PICTURE_BYTES)},
        {"frame": grown(PICTURE)},
        {"room": jpeg(641, 8)},
        {"border": (0.1, 0.2)},
        {"game": (float("nan"),) * 8},
        {"game": (1e9,) * 8},
        {"wanted": 32},
        {"actions": (0, 18)},
        {"actions": (0,)},
        {"values": (0.0,) * 257, "actions": ()},
        {"values": (0.0, float("inf"))},
        {"chosen": 2},
        {"streams": 0},
        {"score": "<b>"},
    ],
)
def test_anything_else_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(MessageError):
        LiveView.decode(replace(VIEW, **wrong).encode())
