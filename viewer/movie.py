"""Films of pictures, written while the pictures are made: MP4 or GIF."""

import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from common.atomic_file import check_new_file
from common.errors import InputError

_LONGEST_GIF = 120
"""Maximum length of a GIF, seconds of play; it takes 350 MB of memory."""
_SMPTE_170M, _LIMITED, _BT_709, _SRGB = 6, 1, 1, 13
"""FFmpeg's numbers for the YUV matrix, the range, the primaries and the transfer function."""

Add = Callable[[NDArray[np.uint8]], None]
"""Adds the film's next picture, ``uint8 [height, width, 3]``; all pictures have one size."""


def check_movie(path: Path, seconds: float, chapters: int = 1) -> None:
    """Raises InputError if ``path`` ends in neither .mp4 nor .gif, cannot be written, or is a GIF
    that would become too long.

    Args:
        seconds: length of each of its ``chapters``; 0 if it is unknown.
    """
    _opener(path)
    check_new_file(path)
    most = _LONGEST_GIF / chapters
    if path.suffix.lower() == ".gif" and not 0 < seconds <= most:
        raise InputError(
            "a GIF stays in memory until it is complete: choose --seconds up to "
            f"{math.floor(10 * most) / 10:g}, or an .mp4."
        )


def open_movie(path: Path, rate: float) -> AbstractContextManager[Add]:
    """Opens a film with ``rate`` pictures per second; it is complete once its context is left.

    Until then, and after an error or without a picture, what was at ``path`` stays there. Its
    folder is made. Raises InputError if ``path`` ends in neither .mp4 nor .gif, and OSError within
    the context if the film cannot be written.
    """
    return _beside(path, rate, _opener(path))


@contextmanager
def _beside(
    path: Path, rate: float, opener: Callable[[Path, float], AbstractContextManager[Add]]
) -> Iterator[Add]:
    """Writes the film beside ``path``, and renames it once it is complete."""
    fresh = path.with_name(path.name + ".tmp")
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh.unlink(missing_ok=True)  # left by a killed process, or a link to somewhere else
    try:
        with opener(fresh, rate) as add:
            yield add
        if fresh.exists():
            fresh.replace(path)
    finally:
        fresh.unlink(missing_ok=True)


def _opener(path: Path) -> Callable[[Path, float], AbstractContextManager[Add]]:
    """Returns the function that opens a film at ``path``. Raises InputError if it ends in neither
    .mp4 nor .gif."""
    opener = {".mp4": _mp4, ".gif": _gif}.get(path.suffix.lower())
    if opener is None:
        raise InputError(f"{path} is not a film's name: let it end in .mp4 or .gif.")
    return opener


@contextmanager
def _mp4(path: Path, rate: float) -> Iterator[Add]:
    """Writes H.264 with the index first, which every browser plays."""
    import av

    # An absolute path, because FFmpeg takes everything before a colon for a protocol.
    name, options = str(path.absolute()), {"movflags": "+faststart"}
    with av.open(name, "w", format="mp4", options=options) as film:
        stream = film.add_stream("libx264", rate=Fraction(rate).limit_denominator(1_000))
        stream.pix_fmt = "yuv420p"
        # How FFmpeg converts RGB. Without these tags, browsers assume BT.709 for large pictures.
        context = stream.codec_context
        context.colorspace, context.color_range = _SMPTE_170M, _LIMITED
        context.color_primaries, context.color_trc = _BT_709, _SRGB
        # Text and lines stay sharp; a film of 20 s takes about a megabyte.
        stream.options = {"crf": "20", "preset": "veryfast"}
        begun = False

        def add(picture: NDArray[np.uint8]) -> None:
            nonlocal begun
            if not begun:
                begun = True
                stream.height, stream.width = picture.shape[:2]
            film.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))

        yield add
        if begun:
            film.mux(stream.encode())


@contextmanager
def _gif(path: Path, rate: float) -> Iterator[Add]:
    """Writes an animated GIF at half the size; each picture has its own palette."""
    pictures: list[Image.Image] = []

    def add(picture: NDArray[np.uint8]) -> None:
        height, width = picture.shape[:2]
        small = cv2.resize(picture, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        pictures.append(Image.fromarray(small).quantize(128))

    yield add
    if pictures:
        # GIF counts in hundredths of a second, Pillow in milliseconds.
        pause = round(100 / rate) * 10
        pictures[0].save(
            path, "GIF", save_all=True, append_images=pictures[1:], duration=pause, loop=0
        )
