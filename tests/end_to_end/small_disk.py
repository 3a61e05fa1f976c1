"""The learner on a disk of which a file says how many bytes are free.

python small_disk.py FILE LEARNER'S-ARGUMENTS
"""

import runpy
import shutil
import sys
from pathlib import Path

free = Path(sys.argv.pop(1))
real = shutil.disk_usage
shutil.disk_usage = lambda path: real(path)._replace(free=int(free.read_text()))
runpy.run_module("learner", run_name="__main__", alter_sys=True)
