"""Writes pictures to files."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from common.atomic_file import check_new_file, write_atomically
from common.errors import InputError, writing

_FORMATS = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff", ".ppm")
"""Ends of names that OpenCV writes in colours, whichever version and build it is."""


def check_picture(path: Path) -> None:
    """Makes the folder of a picture that will be written. Raises InputError if it could not be
    written."""
    if _as_named(path) not in _FORMATS:
        raise InputError(f"{path} does not name a picture: choose a name that ends in .png.")
    check_new_file(path)


def write_picture(path: Path, picture: NDArray[np.uint8]) -> None:
    """Writes ``picture uint8 [rows, columns, 3]``. Raises InputError if it cannot be written."""
    check_picture(path)
    _, content = cv2.imencode(_as_named(path), picture[:, :, ::-1])
    with writing(path):
        write_atomically(path, content.tobytes())


def _as_named(path: Path) -> str:
    """Returns the format of a picture by its name's end, PNG without one."""
    return path.suffix.lower() or ".png"
