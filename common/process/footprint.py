"""Memory of a process, with and without pages of mapped files."""

from pathlib import Path
from typing import NamedTuple


class Footprint(NamedTuple):
    """Memory of a process, bytes."""

    resident: int
    """All pages in memory, with pages of the ring's files, which the kernel may drop."""
    private: int
    """Pages without a file behind them."""


def footprint(process: int | str = "self") -> Footprint:
    """Returns Linux's values of the process of that number, by default of this one."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    fields = dict(line.split(":", 1) for line in lines if ":" in line)
    resident, private = (int(fields[name].split()[0]) * 1024 for name in ("VmRSS", "RssAnon"))
    return Footprint(resident, private)
