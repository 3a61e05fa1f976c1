"""What a full or read-only disk refuses is written when it can be; what will not pass ends it."""

import errno
import os
import threading

import pytest

from learner.insist import insist
from tests.full_disk import Stop


class Disk:
    """A file that can be written, but for the first so many times."""

    def __init__(self, refusals: float, number: int) -> None:
        self.tries = 0
        self._refusals = refusals
        self._number = number

    def write(self) -> str:
        self.tries += 1
        if self.tries <= self._refusals:
            raise OSError(self._number, os.strerror(self._number), "FILE")
        return "written"


def test_a_disk_that_takes_it_is_not_spoken_of() -> None:
    said: list[str] = []
    assert insist(Disk(0, 0).write, said.append, Stop()) == "written"
    assert said == []


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EROFS])
def test_one_that_has_no_room_for_a_while_is_waited_for(number: int) -> None:
    said: list[str] = []
    disk = Disk(2, number)
    assert insist(disk.write, said.append, Stop()) == "written"
    assert disk.tries == 3
    assert said == [
        f"WARNING: FILE cannot be written ({os.strerror(number)}): training waits until it can.",
        "The disk can be written again: training continues.",
    ]


def test_a_long_wait_is_told_every_minute() -> None:
    said: list[str] = []
    disk = Disk(4, errno.ENOSPC)
    seconds = iter((0.0, 0.0, 30.0, 59.9, 60.0, 60.0))
    assert insist(disk.write, said.append, threading.Event(), lambda: next(seconds)) == "written"
    assert [text.split()[0] for text in said] == ["WARNING:", "WARNING:", "The"]


def test_a_stop_ends_the_wait() -> None:
    said: list[str] = []
    disk = Disk(float("inf"), errno.ENOSPC)
    with pytest.raises(OSError, match="No space"):
        insist(disk.write, said.append, Stop())
    assert (disk.tries, len(said)) == (4, 1)


def test_who_gives_up_when_stopped_has_written_nothing() -> None:
    said: list[str] = []
    stop = threading.Event()
    disk = Disk(2, errno.ENOSPC)

    def write() -> str | None:
        return None if stop.is_set() else disk.write()

    def say(text: str) -> None:
        said.append(text)
        stop.set()

    assert insist(write, say, stop) is None
    assert len(said) == 1, "nobody made room"


def test_what_will_not_pass_is_not_waited_for() -> None:
    disk = Disk(float("inf"), errno.EACCES)
    with pytest.raises(PermissionError):
        insist(disk.write, print, Stop())
    assert disk.tries == 1


def test_a_write_that_was_under_way_when_the_stop_came_is_tried_once_more() -> None:
    stop = threading.Event()
    disk = Disk(1, errno.ENOSPC)

    def write() -> str:
        if not stop.is_set():
            stop.set()
        return disk.write()

    assert insist(write, print, stop) == "written"
