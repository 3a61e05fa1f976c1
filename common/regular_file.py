"""Opens files that somebody named or may have replaced, without following links or waiting."""

import errno
import os
import stat
from pathlib import Path


def read_file(path: Path, most: int = -1) -> bytes:
    """Returns the content of ``path``, or its first ``most`` bytes. Raises OSError if it cannot be
    read, or is a pipe or a device, whose reader might wait for ever."""
    with open(path, "rb", opener=not_waiting) as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(errno.EINVAL, "it is not a regular file", str(path))
        return file.read(most)


def no_links(path: str, flags: int) -> int:
    """Opens a file, but neither follows a link nor waits; an opener for `open`."""
    return not_waiting(path, flags | os.O_NOFOLLOW)


def not_waiting(path: str, flags: int) -> int:
    """Opens a file, but does not wait for the other end of a pipe; an opener for `open`."""
    return os.open(path, flags | os.O_NONBLOCK, 0o644)
