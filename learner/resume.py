"""The command that continues a run, for people and for programs that start it again."""

import os
import shlex
from collections.abc import Sequence

from common.command_line.parser import started_by, without_flags


def resume_flags(arguments: Sequence[str], run: str, *, done: bool) -> list[str]:
    """Returns the flags that continue a run which was started with ``arguments``.

    Args:
        done: whether the run has reached its --steps, which are then omitted.
    """
    # `ale-robot train` adds --local by itself.
    added = started_by("learner").startswith("ale-robot ") or "--no-local" in arguments
    told = without_flags(
        arguments,
        ["--initial", "--demonstrations", *(["--steps"] if done else [])],
        ["--force", *(["--local"] if added else [])],
    )
    flags = {argument.partition("=")[0] for argument in told}
    more = [] if "--run" in flags else ["--run", run]
    more += [] if "--resume" in flags else ["--resume"]
    more += ["--steps", "None"] if done and "--config" in flags else []  # the file may have them
    return [*told, *more]


def resume_command(arguments: Sequence[str], run: str, *, done: bool, force: bool = False) -> str:
    """Returns the command that continues a run, see `resume_flags`: that of the experiment of which
    it is a part; or that of make, if make started the run and would give the same flags; or else
    this program's name with them.

    Args:
        force: whether the command should go on whatever the health checks say.
    """
    if experiment := os.environ.get("ALE_ROBOT_EXPERIMENT"):
        return experiment
    flags = [*resume_flags(arguments, run, done=done), *(["--force"] if force else [])]
    by_make = os.environ.get("ALE_ROBOT_AGAIN")
    if by_make and {*arguments} ^ {*flags} <= {"--local", "--resume"}:
        return by_make
    # Who only uses make has no program of ours on the path.
    where = ".venv/bin/" if by_make else ""
    return where + shlex.join([*started_by("learner").split(), *flags])
