"""Suppression of PyBullet's output.

PyBullet's C code prints a build time on import and a line per merged link and per odd URDF element.
``contextlib.redirect_stdout`` does not reach C code, so this module redirects file descriptors.
"""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_LIBC = ctypes.CDLL(None)


@contextmanager
def silenced() -> Iterator[None]:
    """Discards what this process writes to descriptors 1 and 2, C buffers included.

    This silences all threads of the process, so keep the block short.
    """
    _flush()
    kept = os.dup(1), os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        yield
    finally:
        # C's stdio may still buffer output of the block.
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
