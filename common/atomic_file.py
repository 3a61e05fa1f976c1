"""Writes files whole or not at all, and tells beforehand whether that can work."""

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from common.errors import InputError, writing
from common.regular_file import no_links


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Gives errors of the disk the name of the file, which those of an open file lack."""
    try:
        yield
    except OSError as error:
        if error.errno is not None and error.filename is None:
            error.filename = str(path)
        raise


def check_new_file(file: Path) -> None:
    """Makes the folder of a file that will be written. Raises InputError if the file could not be
    written."""
    if file.is_dir():
        raise InputError(f"{file} is a folder: name a file in it.")
    # The new file replaces what is there; root could replace a device.
    if file.is_symlink() or (file.exists() and not file.is_file()):
        raise InputError(f"{file} is not a regular file: name one, or a new one.")
    with writing(file):
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=file.parent):
            pass


def write_atomically(path: Path, content: bytes, former: Path | None = None) -> None:
    """Replaces the content of ``path``. A reader sees the old or the new content, never a part.

    The content is on the disk when this returns.

    Args:
        former: path at which the old content is kept, once the new one is on the disk.
    """
    fresh, kept = path.with_name(path.name + ".tmp"), path.with_name(path.name + ".kept")
    fresh.unlink(missing_ok=True)  # left by a killed process, or a link to somewhere else
    try:
        with naming(path), fresh.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        if former is not None and path.exists():
            # A link comes first, so that a file is at `path` at every moment.
            kept.unlink(missing_ok=True)
            try:
                os.link(path, kept)
            except OSError:  # as on a FAT disk, which has no links
                shutil.copyfile(path, kept, follow_symlinks=False)
            kept.replace(former)
        fresh.replace(path)
    except OSError:
        for partial in (fresh, kept):  # it must not fill the disk
            partial.unlink(missing_ok=True)
        raise
    _sync_names(path.parent)  # or a power failure could restore the old file


def write_json(path: Path, content: Any) -> None:
    """Replaces the content of ``path``, as `write_atomically` does, by ``content`` as JSON."""
    write_atomically(path, (json.dumps(content, indent=2) + "\n").encode())


def append_whole(path: Path, content: bytes, *, durable: bool = False) -> None:
    """Appends ``content``, whole or not at all, to the file at ``path``, which is made if needed.
    With ``durable``, the content is on the disk when this returns."""
    file = no_links(str(path), os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    try:
        size, rest = os.fstat(file).st_size, content
        try:
            with naming(path):
                while rest:
                    rest = rest[os.write(file, rest) :]
                if durable:
                    os.fsync(file)
                    if not size:
                        _sync_names(path.parent)  # or a power failure could take the new file
        except OSError:
            os.ftruncate(file, size)
            raise
    finally:
        os.close(file)


def put_on_disk(path: Path) -> None:
    """Puts what was written to ``path`` on the disk.

    It uses a descriptor of its own, so that threads that write or close the file need not wait for
    the disk.
    """
    file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
    try:
        os.fdatasync(file)
    finally:
        os.close(file)


def _sync_names(folder: Path) -> None:
    """Puts the names of the files in ``folder`` on the disk."""
    file = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def has_room(folder: Path, count: int) -> bool:
    """Whether the disk of ``folder`` has ``count`` free bytes; a total of 0 means no limit."""
    disk = shutil.disk_usage(folder)
    return not disk.total or count <= disk.free
