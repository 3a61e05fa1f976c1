"""`python -m actors`: a process of robots, or of emulators alone, that joins a run and plays."""

if __name__ == "__main__":
    import os
    import sys

    # A working directory that does not hold this package may hold another `common`.
    if not sys.flags.safe_path and sys.path[0] != os.path.dirname(os.path.dirname(__file__)):
        del sys.path[0]
        os.environ["PYTHONSAFEPATH"] = "1"  # for the programs that this one starts

    from common.process.lifeline import leave_at_interrupt, leave_on_leash

    leave_at_interrupt()
    leave_on_leash()

import os
import sys
from collections.abc import Sequence
from itertools import zip_longest

from actors.options import ActorOptions
from common.process.command_line import parse
from common.process.log_lines import say_json
from common.process.program_end import exit_on_input_error

# PyTorch is imported only where it computes, so that help and wrong flags are answered at once.

_VIEWER_COMMANDS = {"--check": "check", "--play": "play", "--human": "human", "--viewer": "play"}
"""Flags of a former version, each with the command of `python -m viewer` that replaced it."""


def viewer_command(arguments: Sequence[str]) -> list[str]:
    """Returns ``arguments`` as arguments of `python -m viewer`; none if they join a run."""
    given = {argument.partition("=")[0] for argument in arguments}
    for flag, command in _VIEWER_COMMANDS.items():
        if flag in given:
            # Only play has a clock; the others always run in lockstep.
            rest = [each for each in arguments if each not in (f"--{command}", "--sync")]
            # A network needs no flag. If it is missing, the viewer says so.
            pairs = zip_longest(rest, rest[1:], fillvalue="-")
            named = (each for each, to in pairs if each != "--weights" or to.startswith("-"))
            return [command, *(each.removeprefix("--weights=") for each in named)]
    return []


def main() -> int:
    if command := viewer_command(sys.argv[1:]):
        os.execv(sys.executable, [sys.executable, "-m", "viewer", *command])
    options = parse(ActorOptions, "actors", sys.argv[1:])
    options.check()
    if options.log_json:
        say_json("evaluator" if options.evaluator else "actor")
    from actors.process import join

    join(options)
    return 0


if __name__ == "__main__":
    exit_on_input_error(main)
