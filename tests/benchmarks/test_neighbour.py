"""The process that makes a core busy: it works, and it goes."""

import os
import time
from contextlib import suppress
from pathlib import Path

from benchmarks.neighbour import neighbour


def _children() -> set[str]:
    found = set()
    for entry in Path("/proc").iterdir():
        with suppress(OSError):  # a process may end while it is looked at
            if (
                entry.name.isdigit()
                and "benchmarks.neighbour" in (entry / "cmdline").read_text(errors="replace")
                and f"\nPPid:\t{os.getpid()}\n" in (entry / "status").read_text()
            ):
                found.add(entry.name)
    return found


def _ticks(pid: str) -> int:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return int(fields[11])


def test_it_works_until_it_is_left() -> None:
    with neighbour():
        (pid,) = _children()
        before = _ticks(pid)
        ends = time.monotonic() + 60.0
        while _ticks(pid) == before and time.monotonic() < ends:
            time.sleep(0.01)
        assert _ticks(pid) > before  # it never would be, did it only wait
    assert not _children()
