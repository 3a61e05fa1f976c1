"""What a forked process does to be a program that was started by Python.

The process that forks has imported PyTorch and the rest, which takes four seconds of a core, once.
"""

import multiprocessing
import os
import runpy
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.paths import ROOT

FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload(
    [
        *("actors.actor", "actors.evaluator", "actors.envs.ale", "actors.envs.robot"),
        *("learner.assembly", "learner.options", "replay.server"),
        "torch._dynamo",  # of every optimizer
        *("tests.end_to_end.forked", "pytest"),
    ]
)


def become(folder: Path, log: Path, arguments: Sequence[str]) -> None:
    """Be `python ARGUMENTS` from now on, in a session and a folder of its own."""
    os.setsid()
    os.chdir(folder)
    with log.open("wb") as file, open(os.devnull) as nothing:
        for stream, source in enumerate((nothing, file, file)):
            os.dup2(source.fileno(), stream)
    # A package that the test puts into its folder is installed.
    sys.path[:0] = [str(ROOT), str(folder)]
    os.environ["PYTHONPATH"] = f"{ROOT}{os.pathsep}{folder}"
    if arguments[0] == "-m":
        sys.argv = list(arguments[1:])
        runpy.run_module(arguments[1], run_name="__main__", alter_sys=True)
    else:
        sys.argv = list(arguments)
        runpy.run_path(arguments[0], run_name="__main__")
