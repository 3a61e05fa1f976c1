"""An append-only file of JSON lines, by which a killed process' successor knows what it had.

A line is written after the data it speaks of, in one `write`, and nothing is acknowledged before.
A killed process loses nothing that was written (the kernel has it), except that its last line
may be cut short; that line was never acknowledged.
"""

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from common.errors import InputError

Entry = dict[str, Any]


def read_journal(path: Path) -> list[Entry]:
    """All whole lines; none if there is no file.

    Raises:
        InputError: a line other than the last is damaged.
    """
    try:
        lines = path.read_bytes().split(b"\n")
    except FileNotFoundError:
        return []
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from None
    entries: list[Entry] = []
    for number, line in enumerate(lines[:-1], start=1):  # what follows the last newline is torn
        try:
            entry = json.loads(line)
        except ValueError:
            entry = None
        if not isinstance(entry, dict):
            raise damaged(path, f"in line {number}")
        entries.append(entry)
    return entries


def damaged(path: Path, how: str) -> InputError:
    """Returns the error that a replay's file is not what it was."""
    return InputError(
        f"{path} is damaged {how}: put it back from a copy, or begin another run, with "
        f"this one's network by --initial {path.parent.parent / 'checkpoint.safetensors'}."
    )


class Journal:
    """The file, open for appending."""

    def __init__(self, path: Path, entries: Iterable[Entry]) -> None:
        """Replace the file by ``entries``."""
        self._path = path
        self._file = -1
        self.rewrite(entries)

    def append(self, entry: Entry) -> None:
        """Write one line, whole or not at all."""
        line = _line(entry)
        written = 0
        try:
            while written < len(line):
                written += os.write(self._file, line[written:])
        except OSError:
            os.ftruncate(self._file, self._size)
            raise
        self._size += len(line)
        self.lines += 1

    def rewrite(self, entries: Iterable[Entry]) -> None:
        """Replace the file by ``entries``, atomically."""
        lines = [_line(entry) for entry in entries]
        fresh = self._path.with_suffix(".tmp")
        try:
            fresh.write_bytes(b"".join(lines))
            fresh.replace(self._path)
            self.close()
            self._file = os.open(self._path, os.O_WRONLY | os.O_APPEND)
        except OSError as error:
            raise InputError(f"{self._path} cannot be written: {error.strerror}.") from None
        self._size = os.fstat(self._file).st_size
        self.lines = len(lines)

    def close(self) -> None:
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def _line(entry: Entry) -> bytes:
    return json.dumps(entry, separators=(",", ":")).encode() + b"\n"
