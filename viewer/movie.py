"""A film of pictures, written while they are made: MP4, or GIF where the name ends so."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import InputError


class Movie(Protocol):
    """Takes pictures of one size, ``uint8 [height, width, 3]``, one after the other."""

    def add(self, picture: NDArray[np.uint8]) -> None: ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...


def open_movie(path: Path, rate: float) -> Movie:
    """A film at ``rate`` pictures a second, complete once its context is left.

    Raises:
        InputError: neither .mp4 nor .gif; the file cannot be written; a GIF without Pillow.
    """
    kinds: dict[str, Callable[[Path, float], Movie]] = {".mp4": _Mp4, ".gif": _Gif}
    kind = kinds.get(path.suffix.lower())
    if kind is None:
        raise InputError(f"{path} is no film's name: let it end in .mp4 or .gif.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("ab").close()
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}.") from None
    return kind(path, rate)


class _Mp4:
    """MPEG-4 by the codec that comes with OpenCV; opened at the first picture, for its size."""

    def __init__(self, path: Path, rate: float) -> None:
        self._path, self._rate = path, rate
        self._writer: cv2.VideoWriter | None = None

    def add(self, picture: NDArray[np.uint8]) -> None:
        if self._writer is None:
            height, width = picture.shape[:2]
            code = cv2.VideoWriter.fourcc(*"mp4v")
            self._writer = cv2.VideoWriter(str(self._path), code, self._rate, (width, height))
            if not self._writer.isOpened():
                raise InputError(
                    f"OpenCV cannot write {self._path}: its build has no MPEG-4; use a .gif name."
                )
        self._writer.write(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._writer is not None:
            self._writer.release()


class _Gif:
    """An animated GIF by Pillow, half as large and with colours of its own for each picture."""

    def __init__(self, path: Path, rate: float) -> None:
        try:
            from PIL import Image
        except ImportError:
            raise InputError(
                "a .gif needs Pillow: pip install pillow, or use a name that ends in .mp4."
            ) from None
        self._image = Image
        self._path, self._rate = path, rate
        self._pictures: list[Any] = []

    def add(self, picture: NDArray[np.uint8]) -> None:
        height, width = picture.shape[:2]
        small = cv2.resize(picture, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        self._pictures.append(self._image.fromarray(small).quantize(128))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pictures:
            first, *others = self._pictures
            # GIF counts in hundredths of a second.
            pause = round(100 / self._rate) * 10
            first.save(self._path, save_all=True, append_images=others, duration=pause, loop=0)
