"""How many processor cores this process may use."""

import math
import os
from collections.abc import Iterator
from pathlib import Path

_GROUPS = Path("/sys/fs/cgroup")
_OWN_GROUP = Path("/proc/self/cgroup")


def usable_cores() -> int:
    """Returns the number of cores: those that the scheduler may take, or fewer if a control group
    (version 2) of this process, such as that of a container, limits its time."""
    return min(len(os.sched_getaffinity(0)), *_limits())


def _limits() -> Iterator[int]:
    """Yields the cores that each control group around this process allows, rounded up."""
    yield os.cpu_count() or 1
    try:
        lines = _OWN_GROUP.read_text().splitlines()
    except OSError:
        return
    own = next((line[3:] for line in lines if line.startswith("0::/")), "/")
    group = Path(own.lstrip("/"))
    for each in (group, *group.parents):
        try:
            quota, period = (_GROUPS / each / "cpu.max").read_text().split()
            yield max(math.ceil(int(quota) / int(period)), 1)
        except (OSError, ValueError):  # "max" is no limit, and the outermost group has no file
            continue
