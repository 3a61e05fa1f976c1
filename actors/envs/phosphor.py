"""The television's phosphor blends two fields of the console into one picture.

ALE can average colours itself, but does so after every emulator frame, which costs more than
emulating the frame. This module blends only pictures that are looked at, and only where they
changed. The result equals ALE's to the last bit, except for games made for PAL televisions: for one
of them, air_raid, ALE's blend is black.
"""

import numpy as np
from numpy.typing import NDArray

_AFTERGLOW = 77
"""Brightness of a blended pixel, in percent of the way from the darker to the brighter field."""
_GREY_WEIGHTS = (0.2989, 0.587, 0.114)

# One row per hue, by brightness, as ALE shows the console's numbers 0, 2, ... 254.
_COLOURS = """
000000 4a4a4a 6f6f6f 8e8e8e aaaaaa c0c0c0 d6d6d6 ececec
484800 69690f 86861d a2a22a bbbb35 d2d240 e8e84a fcfc54
7c2c00 904811 a26221 b47a30 c3903d d2a44a dfb755 ecc860
901c00 a33915 b55328 c66c3a d5824a e39759 f0aa67 fcbc74
940000 a71a1a b83232 c84848 d65c5c e46f6f f08080 fc9090
840064 97197a a8308f b846a2 c659b3 d46cc3 e07cd2 ec8ce0
500084 68199a 7d30ad 9246c0 a459d0 b56ce0 c57cee d48cfc
140090 331aa3 4e32b5 6848c6 7f5cd5 956fe3 a980f0 bc90fc
000094 181aa7 2d32b8 4248c8 545cd6 656fe4 7580f0 8490fc
001c88 183b9d 2d57b0 4272c2 548ad2 65a0e1 75b5ef 84c8fc
003064 185080 2d6d98 4288b0 54a0c5 65b7d9 75cceb 84e0fc
004030 18624e 2d8169 429e82 54b899 65d1ae 75e7c2 84fcd4
004400 1a661a 328432 48a048 5cba5c 6fd26f 80e880 90fc90
143c00 355f18 527e2d 6e9c42 87b754 9ed065 b4e775 c8fc84
303800 505916 6d762b 88923e a0ab4f b7c25f ccd86e e0ec7c
482c00 694d14 866a26 a28638 bb9f47 d2b656 e8cc63 fce070
"""


_PALETTE = np.array([[*bytes.fromhex(colour)] for colour in _COLOURS.split()])
"""Red, green and blue of the 128 colours, ``[128, 3]``."""


def _blends() -> NDArray[np.uint8]:
    """Returns the colour nearest to the blend of any two, ``uint8 [128, 128]``.

    Indices and values are the console's numbers halved. As ALE does, it measures nearness by the
    sum of the differences, in steps of 4.
    """
    first, second = _PALETTE[:, None], _PALETTE[None]
    dark, bright = np.minimum(first, second), np.maximum(first, second)
    blended = ((bright - dark) * _AFTERGLOW // 100 + dark) // 4 * 4
    nearest = np.empty((128, 128), np.uint8)
    for number, row in enumerate(blended):
        nearest[number] = np.abs(row[:, None] - _PALETTE).sum(axis=2).argmin(axis=1)
    return nearest


_BLENDS = _blends()
_RGB = _PALETTE.astype(np.uint8)
_GREY = np.rint(_PALETTE @ np.array(_GREY_WEIGHTS)).astype(np.uint8)


def glow_of_fields(
    picture: NDArray[np.uint8], now: NDArray[np.uint8], before: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    """Blends the field ``before`` into ``picture``, which shows the field ``now``, and returns it.

    Fields hold the console's own colour numbers, ``uint8 [rows, columns]``. ``picture`` has the
    colours of ``now``, ``uint8 [rows, columns, 3]``, or its luminance, ``uint8 [rows, columns]``.
    It is changed in place.
    """
    places = np.flatnonzero(now != before)
    blends = _BLENDS[now.take(places) >> 1, before.take(places) >> 1]
    if picture.ndim == 3:
        picture.reshape(-1, 3)[places] = _RGB[blends]
    else:
        picture.reshape(-1)[places] = _GREY[blends]
    return picture


def glow(now: NDArray[np.uint8], before: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns two pictures blended by brightness, each colour channel by itself.

    It serves televisions whose colours are not in the table above.
    """
    dark, bright = np.minimum(now, before), np.maximum(now, before)
    return np.asarray(dark + ((bright - dark).astype(np.int16) * _AFTERGLOW // 100), np.uint8)


def luminance(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns the luminance of ``picture uint8 [rows, columns, 3]``, ``uint8 [rows, columns]``."""
    return np.asarray(np.rint(picture @ np.array(_GREY_WEIGHTS)), np.uint8)
