"""The learner, to whose checkpoint a file says how many bytes are free on the disk.

python small_disk.py FILE LEARNER'S-ARGUMENTS
"""

import runpy
import sys
from pathlib import Path

from learner import checkpoint

free = Path(sys.argv.pop(1))


def has_room(folder: Path, count: int) -> bool:
    return count <= int(free.read_text())


checkpoint.has_room = has_room  # type: ignore[attr-defined]
runpy.run_module("learner", run_name="__main__", alter_sys=True)
