"""How much memory this process takes, told honestly."""

from pathlib import Path
from typing import NamedTuple


class Footprint(NamedTuple):
    """Bytes of this process."""

    resident: int
    """All pages in memory; pages of the ring's files count, though the kernel may drop them."""
    private: int
    """Pages that no file stands behind."""


def footprint() -> Footprint:
    """As Linux counts it; zeros on other systems."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return Footprint(0, 0)
    fields = dict(line.split(":", 1) for line in lines if ":" in line)
    resident, private = (int(fields[name].split()[0]) * 1024 for name in ("VmRSS", "RssAnon"))
    return Footprint(resident, private)
