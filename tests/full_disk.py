"""A disk that takes a little and then no more, and a stop for whoever waits for it."""

import errno
import os
import resource
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest


def let_the_disk_take(monkeypatch: pytest.MonkeyPatch, *sizes: int) -> None:
    """Lets each of the next `os.write` calls take at most so many bytes; later ones are refused."""
    write, room = os.write, iter(sizes)

    def into_little_room(file: int, content: bytes) -> int:
        if (some := next(room, 0)) == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(file, content[:some])

    monkeypatch.setattr(os, "write", into_little_room)


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Has the system itself refuse to make any file of this process larger."""
    before, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (before, most))


class Stop(threading.Event):
    """Never waits; set at the third wait."""

    waits = 0

    def wait(self, timeout: float | None = None) -> bool:
        self.waits += 1
        if self.waits == 3:
            self.set()
        return self.is_set()
