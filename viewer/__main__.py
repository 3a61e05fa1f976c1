"""`python -m viewer`: checks a robot, shows it at play, or lets a person play, without any run."""

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
import threading
from typing import Any, get_args

import cv2

from common.command_line.parser import parse
from common.command_line.played import parse_played
from common.errors import InputError
from common.process.lifeline import on_signals
from common.process.log_lines import LOADING, say, say_aside
from common.process.program_end import exit_on_input_error
from viewer.check import Check
from viewer.draws import Draws
from viewer.film import Film
from viewer.human import Human
from viewer.record import Record
from viewer.show import Play
from viewer.watch import Watch

EVERY: Any = Watch | Play | Film | Record | Human | Check | Draws
COMMANDS: dict[str, Any] = {kind.__name__.lower(): kind for kind in get_args(EVERY)}


class _ToldStop(threading.Event):
    """Says at once that the program stops: its present step and the end of a film take seconds."""

    def set(self) -> None:
        super().set()
        # In a thread: even where nobody reads, a second signal ends the program.
        threading.Thread(target=say_aside, args=("stopping ...",), daemon=True).start()


def main() -> int:
    name, *arguments = sys.argv[1:] or ["--help"]
    kind = COMMANDS.get(name)
    had_weights = kind not in (Human, Check, Draws)  # where no network was ever named
    if had_weights and any(argument.partition("=")[0] == "--weights" for argument in arguments):
        raise InputError("--weights is gone: name the network alone, as in `watch robot_pong`.")
    command: Any
    if kind is None:
        command = parse(EVERY, "viewer", [name, *arguments])  # which tells the commands, and ends
    else:
        command = parse_played(kind, f"viewer {name}", arguments)
    command.check()
    # A line would be in the picture that a terminal shows.
    stop = threading.Event() if isinstance(command, Watch | Human) else _ToldStop()
    on_signals(stop)
    if not isinstance(command, Human | Draws):  # where no network plays
        # Not before the command is known: help and a wrong flag come at once.
        if sys.stdout.isatty():
            say(LOADING)
        import torch

        torch.set_num_threads(1)
    cv2.setNumThreads(1)
    status: int | None = command.run(stop)
    return status or 0


if __name__ == "__main__":
    exit_on_input_error(main)
