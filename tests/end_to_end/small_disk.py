"""The learner, to whose checkpoint a file says how many bytes are free on the disk.

python small_disk.py FILE LEARNER'S-ARGUMENTS
"""

import runpy
import sys
from pathlib import Path

from learner import checkpoint

free = Path(sys.argv.pop(1))
checkpoint.has_room = lambda _, count: count <= int(free.read_text())
runpy.run_module("learner", run_name="__main__", alter_sys=True)
