"""Stands for `python -m viewer`: writes what it was asked for as its film, and fails at epoch 2."""

import sys
from pathlib import Path

if __name__ == "__main__":
    film, *flags = sys.argv[1:]
    asked = dict(zip(flags[::2], flags[1::2], strict=True))
    weights, video = Path(asked["--weights"]), Path(asked["--video"])
    video.write_text(f"{film} {weights.read_text()} {asked['--seconds']}")
    if weights.stem == "epoch-0002":
        sys.exit("error: no picture.")
