"""Stands for `python -m viewer`: writes what it was asked for as its film, fails at epoch 2, and at
epoch 3 goes on until it is asked to leave."""

import sys
from pathlib import Path

if __name__ == "__main__":
    film, network, *flags, leash = sys.argv[1:]
    assert leash == "--leash"
    asked = dict(zip(flags[::2], flags[1::2], strict=True))
    weights, video = Path(network), Path(asked["--video"])
    epsilon = f" {asked['--epsilon']}" if "--epsilon" in asked else ""
    video.write_text(f"{film} {weights.read_text()} {asked['--seconds']}{epsilon}")
    if weights.stem == "epoch-0002":
        sys.exit("error: no picture.")
    if weights.stem == "epoch-0003":
        sys.stdin.read()
