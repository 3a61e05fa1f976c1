"""The ring's files: one preallocated file per column, one row per slot.

Rows are written with `pwrite` and read through a shared mapping. Both use the kernel's page cache,
so written rows survive the end of the process, and writing needs no page faults (on a fresh file it
is 40 times as fast as storing through the mapping).
"""

import contextlib
import errno
import fcntl
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.atomic_file import has_room, put_on_disk
from common.errors import InputError
from common.protocol.step_fields import STEP_FIELDS, Column
from replay.damage import damaged


class Columns:
    """Arrays of ``capacity`` rows under ``folder``, one for each `Column` of `STEP_FIELDS`."""

    rows: dict[str, NDArray[Any]]
    """Read-only views ``[capacity, ...]`` by name of the field; ``flags`` holds all flags."""
    priorities: NDArray[np.float64]
    """Priorities to the power of α, writable in place, padded to ``priority_slots``."""

    def __init__(
        self,
        folder: Path,
        capacity: int,
        vector_width: int,
        *,
        priority_slots: int = 0,
        existing: bool = False,
    ) -> None:
        """Creates the files with all the space that they will ever need, or opens ``existing``
        ones. Raises InputError if there is no space or permission, another process uses the folder,
        or files are missing that should exist."""
        self.capacity = capacity
        self.folder = folder
        self._files: dict[str, int] = {}
        self._created: list[Path] = []
        sizes_of = {"T": capacity, "P": vector_width}
        layout: dict[str, tuple[Any, tuple[int, ...]]] = {
            name: (field.dtype, field.array.shape_for(sizes_of))
            for name, field in STEP_FIELDS.items()
            if isinstance(field.array, Column)
        }
        layout["flags"] = (np.uint8, (capacity,))
        layout["priorities"] = (np.float64, (priority_slots,))
        sizes = {
            name: math.prod(shape) * np.dtype(dtype).itemsize
            for name, (dtype, shape) in layout.items()
        }
        if existing:
            self._check(sizes)
        self._allocate(sizes)
        self.rows = {name: self._map(name, *each) for name, each in layout.items()}
        self.priorities = self.rows.pop("priorities")

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.bin"

    def _check(self, sizes: dict[str, int]) -> None:
        for name, size in sizes.items():
            if name == "priorities":
                continue  # a cache that the learner fills, not data: a ring works without it
            path = self._path(name)
            if not path.is_file() or path.stat().st_size != size:
                raise damaged(path, f"or missing (it should have {size:,} bytes)")

    def _allocate(self, sizes: dict[str, int]) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            new = sum(size for name, size in sizes.items() if not self._path(name).exists())
            if not has_room(self.folder, new):  # or allocation would fill the disk and then fail
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            for name, size in sizes.items():
                path = self._path(name)
                if not path.exists():
                    self._created.append(path)
                how = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW
                self._files[name] = file = os.open(path, how, 0o644)
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # before it is changed
                os.ftruncate(file, size)
                if size:
                    os.posix_fallocate(file, 0, size)
        except BlockingIOError:
            self.close()
            raise InputError(f"another process uses the replay in {self.folder}.") from None
        except OSError as error:
            self.discard()
            raise InputError(
                f"the replay needs {sum(sizes.values()):,} bytes in {self.folder} and cannot have "
                f"them ({error.strerror}): free some space, name another folder with --runs, "
                "or lower --replay.capacity."
            ) from None

    def _map(self, name: str, dtype: Any, shape: tuple[int, ...]) -> NDArray[Any]:
        if 0 in shape:
            return np.zeros(shape, dtype)
        mode: Any = "r+" if name == "priorities" else "r"
        mapped = np.memmap(self._path(name), dtype, mode, shape=shape)
        return np.asarray(mapped)  # without memmap's own, slow indexing

    def write(self, name: str, row: int, values: NDArray[Any]) -> None:
        """Writes ``values`` to the rows from ``row % capacity`` on, and around the end if
        needed."""
        if not values.size:
            return
        values = np.ascontiguousarray(values)
        row %= self.capacity
        until_end = self.capacity - row
        for at, part in ((row, values[:until_end]), (0, values[until_end:])):
            rest = part.reshape(-1).view(np.uint8).data
            offset = at * (part.nbytes // max(len(part), 1))
            while len(rest):
                done = os.pwrite(self._files[name], rest, offset)
                rest, offset = rest[done:], offset + done

    def sync(self) -> None:
        """Puts all rows on the disk. Other threads may write, or close, meanwhile."""
        for name in self.rows:
            put_on_disk(self._path(name))

    @property
    def file_bytes(self) -> int:
        """Space that the files really take on disk, bytes."""
        return sum(self._path(name).stat().st_blocks * 512 for name in (*self.rows, "priorities"))

    def close(self) -> None:
        """Closes the files; the views stay readable."""
        while self._files:
            os.close(self._files.popitem()[1])

    def discard(self) -> None:
        """Closes the files, and removes those that were created here: an unused ring would keep the
        disk full, and bind the run to its settings."""
        self.close()
        for path in self._created:
            path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # if it is missing or holds something else
            self.folder.rmdir()
