"""Keeping PyBullet's prints out of the terminal.

Its C code prints a build time on import, a line per merged link and per odd URDF element.
``contextlib.redirect_stdout`` does not reach those, so the file descriptors are turned away.
"""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_LIBC = ctypes.CDLL(None)


@contextmanager
def silenced() -> Iterator[None]:
    """Send what this process writes to descriptors 1 and 2 to nowhere, C buffers included.

    It is the whole process that is silent, other threads too, so keep the block short.
    """
    _flush()
    kept = os.dup(1), os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        yield
    finally:
        # C's stdio may still hold what was printed inside the block.
        _flush()
        os.dup2(kept[0], 1)
        os.dup2(kept[1], 2)
        for descriptor in (nowhere, *kept):
            os.close(descriptor)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        if stream is not None and not stream.closed:
            stream.flush()
    _LIBC.fflush(None)
