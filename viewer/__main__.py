"""`python -m viewer`: checks a robot, shows it at play, or lets a person play, without any run."""

if __name__ == "__main__":
    from common.process.lifeline import leave_at_interrupt

    leave_at_interrupt()

import sys
import threading
from typing import Any

import cv2
import torch

from common.errors import exit_on_input_error
from common.process.command_line import parse
from common.process.lifeline import on_signals
from viewer.check import Check
from viewer.draws import Draws
from viewer.human import Human
from viewer.show import Play

COMMANDS: Any = Check | Play | Human | Draws


def main() -> int:
    command = parse(COMMANDS, "viewer", sys.argv[1:])
    stop = threading.Event()
    on_signals(stop)
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    status: int = command.run(stop)
    return status


if __name__ == "__main__":
    exit_on_input_error(main)
