"""`python -m tests.benchmarks.chaos.paced MODULE ARGUMENTS`: a program whose games take their time.

A step of ALE lasts 8 ms longer, in which other processes have the processor.
"""

import runpy
import sys
import time
from typing import Any

from actors.envs.ale import AtariEnv

_SECONDS = 0.008

if __name__ == "__main__":
    step = AtariEnv.step

    def paced(self: AtariEnv, action: Any) -> Any:
        time.sleep(_SECONDS)
        return step(self, action)

    AtariEnv.step = paced  # type: ignore[method-assign]
    sys.argv.pop(0)
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
