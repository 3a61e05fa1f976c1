"""Writes pictures to files."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import InputError, writing


def write_picture(path: Path, picture: NDArray[np.uint8]) -> None:
    """Writes ``picture uint8 [rows, columns, 3]``, and makes its folder if necessary. Raises
    InputError if it cannot be written."""
    try:
        _, content = cv2.imencode(path.suffix or ".png", picture[:, :, ::-1])
    except cv2.error:
        raise InputError(
            f"{path} does not name a picture: choose a name that ends in .png."
        ) from None
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.tobytes())
