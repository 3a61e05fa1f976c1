"""Opens files that somebody named or may have replaced: regular ones, and no links."""

import errno
import os
import stat
from pathlib import Path


def read_file(path: Path, most: int = -1) -> bytes:
    """Returns up to ``most`` bytes of ``path``, or all. Raises OSError if it cannot be read, or is
    a pipe or a device, which might be waited for for ever."""
    file = not_waiting(str(path), os.O_RDONLY)
    with os.fdopen(file, "rb") as opened:
        if not stat.S_ISREG(os.fstat(file).st_mode):
            raise OSError(errno.EINVAL, "it is not a regular file", str(path))
        return opened.read(most)


def no_links(path: str, flags: int) -> int:
    """Opens a file, but not where a link leads, nor waits; for `open`."""
    return not_waiting(path, flags | os.O_NOFOLLOW)


def not_waiting(path: str, flags: int) -> int:
    """Opens a file, but waits for nobody at the other end of a pipe; for `open`."""
    return os.open(path, flags | os.O_NONBLOCK, 0o644)
