"""An append-only file of JSON lines, from which a killed process' successor restores its state.

A line is written after the data that it describes, in one `write`, and nothing is acknowledged
before. A killed process loses nothing that was written, because the kernel has it. Only its last
line may be cut short; that line was never acknowledged. Each line ends with the CRC-32 of what
precedes it, so if a disk loses or changes some lines, only those are lost.
"""

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from common.atomic_file import put_on_disk, write_atomically
from common.crc32 import crc32
from common.errors import cannot_read, writing
from common.regular_file import read_file

Entry = dict[str, Any]
_MARK = b',"crc":'


def read_journal(path: Path) -> list[Entry | None]:
    """Returns all lines, with None for a damaged one; an empty list if there is no file. Raises
    InputError if the file cannot be read."""
    try:
        lines = read_file(path).split(b"\n")
    except FileNotFoundError:
        return []
    except OSError as error:
        raise cannot_read(path, error) from None
    checked = _MARK in lines[0]  # former journals have no checksums
    return [_entry(line, checked) for line in lines[:-1]]  # text after the last newline is torn


def _entry(line: bytes, checked: bool) -> Entry | None:
    body, mark, told = line.rpartition(_MARK)
    if told != b"%d}" % crc32(body) if mark else checked:
        return None
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return entry if isinstance(entry, dict) else None


class Journal:
    """A journal file, open for appending."""

    def __init__(self, path: Path, entries: Iterable[Entry]) -> None:
        """Replaces the file by ``entries``. Raises InputError if the file cannot be written."""
        self._path = path
        self._file = -1
        self.size = 0
        """Size of its whole lines, bytes."""
        self._torn = False
        """Whether the file may end with a partial line."""
        with writing(path):
            self.rewrite(entries)

    def append(self, entry: Entry) -> None:
        """Writes one line, whole or not at all."""
        line = _line(entry)
        written = 0
        if self._torn:  # or this line would continue the torn one, and be lost with it
            os.ftruncate(self._file, self.size)
        self._torn = True
        while written < len(line):
            written += os.write(self._file, line[written:])
        self._torn = False
        self.size += len(line)

    def rewrite(self, entries: Iterable[Entry]) -> None:
        """Replaces the file by ``entries``, atomically."""
        write_atomically(self._path, b"".join(map(_line, entries)))
        self.close()
        self._file = os.open(self._path, os.O_WRONLY | os.O_APPEND | os.O_NOFOLLOW)
        self.size = os.fstat(self._file).st_size

    def sync(self) -> None:
        """Puts all lines on the disk. Other threads may append, or close, meanwhile."""
        put_on_disk(self._path)

    def close(self) -> None:
        """Closes the file; a second call does nothing."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def _line(entry: Entry) -> bytes:
    body = json.dumps(entry, separators=(",", ":")).encode()[:-1]
    return b"%b%b%d}\n" % (body, _MARK, crc32(body))
