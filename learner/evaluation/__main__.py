"""`python -m learner.evaluation`, or `ale-robot evaluate`: evaluates a network over whole games."""

if __name__ == "__main__":
    import os
    import sys

    # A working directory that does not hold this package may hold another `common`.
    if not sys.flags.safe_path and sys.path[0] != os.path.abspath(f"{__file__}/../../.."):
        del sys.path[0]
        os.environ["PYTHONSAFEPATH"] = "1"  # for the programs that this one starts

    from common.process.lifeline import leave_at_interrupt

    leave_at_interrupt()

import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import tyro

from common.command_line.parser import WeightsFile
from common.command_line.played import Played, parse_played
from common.exit_codes import INTERRUPTED
from common.process.lifeline import on_signals
from common.process.log_lines import LOADING, say_aside
from common.process.program_end import exit_on_input_error
from common.settings.clock import ClockConfig
from common.settings.ranges import RandomiseConfig
from learner.evaluation.options import EvaluationOptions

# PyTorch is loaded only where it is needed: help and a wrong flag appear at once.


@dataclass(frozen=True, kw_only=True)
class Evaluation(Played):
    """Evaluate a network over whole games, in several processes.

    It plays under the settings of its training, except for those given here, such as --env,
    --play.actuation-latency, --camera.noise or --seed. No conditions are drawn, even if its
    training drew some, unless a --randomise flag is given.
    """

    ELSEWHERE: ClassVar = {
        "--steps": "is for a training: give --games or --test-steps",
        **dict.fromkeys(
            ("--actors", "--envs", "--evaluators"), "is for a training: give --processes"
        ),
        "--run": "is for a training: name the network alone, as in `ale-robot evaluate first`",
    }

    weights: tyro.conf.Positional[WeightsFile]
    """Network to evaluate, such as robot_pong, a run, or runs/NAME/snapshots/best.safetensors."""
    options: tyro.conf.OmitArgPrefixes[EvaluationOptions] = field(default_factory=EvaluationOptions)
    randomise: RandomiseConfig = field(default_factory=RandomiseConfig)
    clock: tyro.conf.OmitArgPrefixes[ClockConfig] = field(default_factory=ClockConfig)

    @property
    def network(self) -> Path:
        return self.weights

    def check(self) -> None:
        self.options.check()
        self.clock.check(self.env)
        self.config()


def main(arguments: Sequence[str] | None = None) -> int:
    """Evaluates; returns the exit status, `INTERRUPTED` after Ctrl-C or SIGTERM."""
    given = sys.argv[1:] if arguments is None else arguments
    command = parse_played(Evaluation, "learner.evaluation", given)
    command.check()
    say_aside(LOADING)
    from learner.evaluation.offline import evaluate

    stop = threading.Event()
    on_signals(stop)
    found = evaluate(command.network, command.options, command.config(), command.clock, stop)
    return INTERRUPTED if found is None else 0


if __name__ == "__main__":
    exit_on_input_error(main)
