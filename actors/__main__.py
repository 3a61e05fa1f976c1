"""`python -m actors`: a process of robots, or of emulators alone, that joins a run and plays."""

if __name__ == "__main__":
    import os
    import sys

    # A working directory that does not hold this package may hold another `common`.
    if not sys.flags.safe_path and sys.path[0] != os.path.abspath(f"{__file__}/../.."):
        del sys.path[0]
        os.environ["PYTHONSAFEPATH"] = "1"  # for the programs that this one starts

    from common.process.lifeline import leave_at_interrupt, leave_on_leash

    leave_at_interrupt()
    leave_on_leash()

import sys

from actors.options import ActorOptions
from common.command_line.parser import parse
from common.process.log_lines import say_json
from common.process.program_end import exit_on_input_error

# PyTorch is imported only where it computes, so that help and wrong flags are answered at once.


def main() -> int:
    options = parse(ActorOptions, "actors", sys.argv[1:])
    options.check()
    if options.log_json:
        say_json("evaluator" if options.evaluator else "actor")
    from actors.process import join

    join(options)
    return 0


if __name__ == "__main__":
    exit_on_input_error(main)
