"""Memory of a process, with and without pages of mapped files."""

from pathlib import Path
from typing import NamedTuple


class Footprint(NamedTuple):
    """Memory of a process, bytes."""

    resident: int
    """All pages in memory, including pages of the ring's files, which the kernel may drop."""
    private: int
    """Pages that no file backs."""


def footprint(process: int | str = "self") -> Footprint:
    """Returns the footprint of the process with that number, by default of this one, as Linux
    reports it."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    fields = dict(line.split(":", 1) for line in lines if ":" in line)
    resident, private = (int(fields[name].split()[0]) * 1024 for name in ("VmRSS", "RssAnon"))
    return Footprint(resident, private)
