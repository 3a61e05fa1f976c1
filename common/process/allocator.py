"""Lets the C library keep large blocks of memory that were freed.

By default glibc returns them to the system. If a process makes a message of a megabyte a thousand
times a second, the system then clears 256 pages a thousand times a second. On a virtual machine
that takes ten times as long as copying the message.
"""

import ctypes

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Parameters of mallopt, from malloc.h."""
_LARGEST_KEPT = 32 * 1024 * 1024
"""Bytes; the most that glibc allows."""
_MAX_KEPT = 512 * 1024 * 1024


def keep_large_blocks() -> bool:
    """Keeps freed blocks of up to 32 MiB in this process, 512 MiB in all, for later allocations.

    A process that handles minibatches or chunks calls it before the first one. Returns False if the
    C library has no such setting; everything works then, but perhaps more slowly.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    kept = mallopt(_MMAP_THRESHOLD, _LARGEST_KEPT) and mallopt(_TRIM_THRESHOLD, _MAX_KEPT)
    return bool(kept)
