"""`python -m learner`: trains the run's network, and hosts its replay and hub."""

if __name__ == "__main__":
    import os
    import sys

    # A working directory that does not hold this package may hold another `common`.
    if not sys.flags.safe_path and sys.path[0] != os.path.dirname(os.path.dirname(__file__)):
        del sys.path[0]
        os.environ["PYTHONSAFEPATH"] = "1"  # for the programs that this one starts

    from common.process.lifeline import leave_at_interrupt

    leave_at_interrupt()

import sys
import threading
from functools import partial

from common.process.command_line import parse_run
from common.process.exit_codes import INTERRUPTED
from common.process.lifeline import on_signals
from common.process.log_lines import LOADING, say, say_aside, say_json
from common.process.program_end import exit_on_input_error
from common.process.restarts import with_restarts
from learner import status
from learner.options import LearnerOptions, opening, stored_config

# PyTorch is loaded only where it is needed: help, a wrong flag and a status appear at once.


def main() -> int | None:
    if "--status" in sys.argv[1:]:
        return status.main([each for each in sys.argv[1:] if each != "--status"])
    options, stored = parse_run(LearnerOptions, "learner", sys.argv[1:], stored_config)
    options.check()
    if options.evaluation.evaluate is not None:
        say_aside(LOADING)
        from learner.evaluation.offline import evaluate

        stop = threading.Event()
        on_signals(stop)
        found = evaluate(options.evaluation, options.config, stored, options.clock, stop)
        return INTERRUPTED if found is None else 0
    if options.log_json:
        say_json("learner")
    options.check_here()
    say(opening(options))
    from learner.process import train

    return with_restarts("the learner", partial(train, options), options.restart)


if __name__ == "__main__":
    exit_on_input_error(main)
