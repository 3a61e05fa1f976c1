"""What the C library does with large blocks of memory that were freed.

By default glibc gives them back to the system, so that a process which makes a message of a
megabyte a thousand times a second has the system clear a thousand times 256 pages: on a virtual
machine that takes ten times as long as copying the message.
"""

import ctypes

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Parameters of mallopt, from malloc.h."""
_LARGEST_KEPT = 32 * 1024 * 1024
"""Bytes; as many as glibc allows."""
_MOST_KEPT = 512 * 1024 * 1024


def keep_large_blocks() -> bool:
    """Keep freed blocks of up to 32 MiB in this process, 512 MiB in all, for those that come next.

    For processes through which minibatches or chunks go; to be called before they do. False where
    the C library has no such setting: everything works, slower perhaps.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    kept = mallopt(_MMAP_THRESHOLD, _LARGEST_KEPT) and mallopt(_TRIM_THRESHOLD, _MOST_KEPT)
    return bool(kept)
