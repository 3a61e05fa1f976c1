"""`ale-robot COMMAND`: one command in front of the programs of all packages."""

import os
import sys
from importlib import import_module
from itertools import takewhile

from ale_robot import __version__
from ale_robot.commands import MEANT, POLICY_COMMANDS, PROGRAMS, help_of, overview
from common.errors import InputError, choice
from common.process.lifeline import leave_at_interrupt
from common.process.program_end import exit_on_input_error


def run() -> int | None:
    """Runs the program that the command line names; returns its exit status."""
    name, *arguments = sys.argv[1:] or ["--help"]
    if name == "help":  # as of git: `ale-robot help train`
        name, *arguments = [*arguments, "--help"]
    if name == "--version":
        print(f"ale-robot {__version__}")
        return 0
    if name in ("-h", "--help", "--help-all"):
        print(overview(everything=name == "--help-all"))
        return 0
    if name not in PROGRAMS:
        meant = MEANT.get(name) or choice(name, list(PROGRAMS))
        raise InputError(f"there is no command {name!r}: {meant}")
    helps = {"-h", "--help", "--help-all"} & {*arguments}
    if helps and name == "policies" and arguments[0] in POLICY_COMMANDS:
        arguments = [arguments[0], "--help"]
    elif helps - {"--help-all"}:
        print(help_of(name))
        return 0
    module, *given = PROGRAMS[name]
    if "--help-all" in arguments:
        named = [argument for argument in arguments if argument != "--help-all"]
        given, arguments = [*takewhile(str.isalpha, given)], ["--help", *named]
    sys.argv = [f"ale-robot {name}", *given, *arguments]
    try:
        program = import_module(module)
    except ModuleNotFoundError as error:
        raise InputError(
            f"`ale-robot {name}` needs the package {error.name}, which is not installed: "
            f"pip install {error.name}."
        ) from None
    status: int | None = program.main()
    return status


def main() -> None:
    """Runs the command and exits with its status."""
    leave_at_interrupt()
    # Child processes must import the same packages, whatever is in the working directory.
    os.environ["PYTHONSAFEPATH"] = "1"
    exit_on_input_error(run)


if __name__ == "__main__":
    main()
