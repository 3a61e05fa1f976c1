"""`python -m learner`: trains the run's network, and hosts its replay and hub."""

if __name__ == "__main__":
    import os
    import sys

    # A working directory that does not hold this package may hold another `common`.
    if not sys.flags.safe_path and sys.path[0] != os.path.abspath(f"{__file__}/../.."):
        del sys.path[0]
        os.environ["PYTHONSAFEPATH"] = "1"  # for the programs that this one starts

    from common.process.lifeline import leave_at_interrupt

    leave_at_interrupt()

import sys
from collections.abc import Sequence
from functools import partial

from common.command_line.first_flags import read_first
from common.command_line.run_options import parse_run
from common.process.log_lines import say, say_json
from common.process.program_end import exit_on_input_error
from common.process.restarts import with_restarts
from learner import status
from learner.evaluation import __main__ as evaluation
from learner.options import LearnerOptions, opening, stored_config

# PyTorch is loaded only where it is needed: help, a wrong flag and a status appear at once.


def main() -> int | None:
    if "--status" in sys.argv[1:]:  # `ale-robot train` adds --local
        return status.main([each for each in sys.argv[1:] if each not in ("--status", "--local")])
    if (asked := _evaluation(sys.argv[1:])) is not None:
        return evaluation.main(asked)
    options = parse_run(LearnerOptions, "learner", sys.argv[1:], stored_config)
    options.check()
    if options.log_json:
        say_json("learner")
    options.check_here()
    say(opening(options))
    from learner.process import train

    return with_restarts("the learner", partial(train, options), options.restart)


def _evaluation(arguments: Sequence[str]) -> list[str] | None:
    """Returns the arguments of the evaluation that --evaluate asks for; None without that flag."""
    known, rest = read_first(arguments, {"network": ["--evaluate"]})
    if not known and "--evaluate" not in rest:
        return None
    # `ale-robot train` adds --local. Without its network the flag itself is left.
    flags = [argument for argument in rest if argument not in ("--local", "--evaluate")]
    return [*known.values(), *flags]


if __name__ == "__main__":
    exit_on_input_error(main)
