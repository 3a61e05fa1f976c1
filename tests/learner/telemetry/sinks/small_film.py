"""A film that is made in no time."""

from pathlib import Path

import av
import numpy as np


def write_film(path: Path, pictures: int, rate: int = 15) -> Path:
    """Writes a film that grows brighter, 64 × 48 pixels."""
    with av.open(str(path), "w") as film:
        stream = film.add_stream("libx264", rate=rate)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for number in range(pictures):
            picture = np.full((48, 64, 3), 255 * number // pictures, np.uint8)
            film.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        film.mux(stream.encode())
    return path
