"""`Disk`: a small disk for one run, which can be made full or read-only."""

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
"""Smallest number of bytes that a file system allocates."""
_MAX_FILES = 4096
_TRIES = 20


class Disk:
    """A file system in memory, at ``folder``; a context manager, after which the files stay there.

    Args:
        folder: path at which the disk is mounted; it is created.
        size: capacity in bytes.
    """

    def __init__(self, folder: Path, size: int) -> None:
        self.folder = folder
        self.missing: str | None = None
        """Reason why no disk could be mounted at ``folder``; None if it was."""
        self._size = size
        self._ballast = folder / "ballast"

    def __enter__(self) -> Self:
        self.folder.mkdir()
        options = f"size={self._size},nr_inodes={_MAX_FILES}"
        self.missing = _mount("-t", "tmpfs", "-o", options, "chaos", str(self.folder))
        return self

    def __exit__(self, *_: object) -> None:
        if self.missing is None:
            kept = self.folder.with_name(f"{self.folder.name}.kept")
            shutil.copytree(self.folder, kept)
            while self.folder.is_mount():  # twice, if an error came while it was read-only
                self._unmount()
            self.folder.rmdir()
            kept.rename(self.folder)

    def fill(self) -> Callable[[], None]:
        """Takes all the room that is left; returns a function that frees it."""
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
        """Creates files until no more can be created, although there is room left in the present
        ones; returns a function that removes them."""
        crowd = self.folder / "crowd"
        crowd.mkdir()
        with suppress(OSError):
            for number in range(_MAX_FILES):
                (crowd / str(number)).touch()
        return partial(shutil.rmtree, crowd)

    def forbid(self) -> Callable[[], None]:
        """Lets no file be created, changed or removed by its name; open files stay open.

        Returns a function that allows it again. Raises OSError if the disk stays writable.
        """
        place = str(self.folder)
        for _ in range(_TRIES):
            if why := _mount("--bind", place, place):
                raise OSError(why)
            if (why := _mount("-o", "remount,bind,ro", place)) is None:
                return self._unmount
            self._unmount()  # a file was opened for writing between the two
        raise OSError(why)

    def _unmount(self) -> None:
        subprocess.run(["umount", "--lazy", self.folder], check=True)
