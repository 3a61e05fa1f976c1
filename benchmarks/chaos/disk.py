"""`Disk`: a small disk of a run's own, which can be full or read-only."""

import os
import shutil
import subprocess
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Self

from benchmarks.child import refusal

_mount = partial(refusal, "mount")
_LEAST = 4096
"""Bytes that a file system gives out at once."""
_MOST_FILES = 4096


class Disk:
    """A file system in memory, at ``folder``; a context manager, after which the files stay there.

    Args:
        folder: is made.
        size: bytes that fit.
    """

    def __init__(self, folder: Path, size: int) -> None:
        self.folder = folder
        self.missing: str | None = None
        """Why ``folder`` could not be mounted as a disk; None if it was."""
        self._size = size
        self._ballast = folder / "ballast"

    def __enter__(self) -> Self:
        self.folder.mkdir()
        options = f"size={self._size},nr_inodes={_MOST_FILES}"
        self.missing = _mount("-t", "tmpfs", "-o", options, "chaos", str(self.folder))
        return self

    def __exit__(self, *_: object) -> None:
        if self.missing is None:
            kept = self.folder.with_name(f"{self.folder.name}.kept")
            shutil.copytree(self.folder, kept)
            self._unmount()
            self.folder.rmdir()
            kept.rename(self.folder)

    def fill(self) -> Callable[[], None]:
        """Take all the room that is left; returns what gives it back."""
        size, more = 0, 2**30
        with self._ballast.open("wb") as file:
            while more >= _LEAST:
                try:
                    os.posix_fallocate(file.fileno(), size, more)
                    size += more
                except OSError:
                    more //= 2
        return self._ballast.unlink

    def crowd(self) -> Callable[[], None]:
        """Make files until there can be no more, although there is room in those that there are;
        returns what removes them."""
        crowd = self.folder / "crowd"
        crowd.mkdir()
        with suppress(OSError):
            for number in range(_MOST_FILES):
                (crowd / str(number)).touch()
        return partial(shutil.rmtree, crowd)

    def forbid(self) -> Callable[[], None]:
        """Let nothing be made, changed or removed by its name; files that are open stay so.
        Returns what allows it again."""
        place = str(self.folder)
        if why := _mount("--bind", place, place) or _mount("-o", "remount,bind,ro", place):
            raise OSError(why)
        return self._unmount

    def _unmount(self) -> None:
        subprocess.run(["umount", "--lazy", self.folder], check=True)
