"""Exit codes of the programs, for people and for whatever restarts a program."""

from typing import NamedTuple


class ExitCode(NamedTuple):
    """A way in which a program may end."""

    number: int
    meaning: str
    again: bool
    """Whether the same command may succeed if it is run again (``--restart``, systemd)."""


DONE = 0
FAILED = 1
BAD_INPUT = 2
RED = 3
UNREACHABLE = 4
NO_ROOM = 75
"""EX_TEMPFAIL of sysexits.h: try again later."""
INTERRUPTED = 130

EXIT_CODES = (
    ExitCode(DONE, "done, or ended by Ctrl-C or SIGTERM with everything saved", False),
    ExitCode(FAILED, "failed, and said why; from check and status: a health check is red", True),
    ExitCode(BAD_INPUT, "cannot do what was asked: wrong flags, settings or files", False),
    ExitCode(RED, "the run ended itself: a health check stayed red, or progress stopped", False),
    ExitCode(UNREACHABLE, "nobody answers at the address, or the run there has ended", True),
    ExitCode(NO_ROOM, "the disk is full or read-only: works once that has changed", True),
    ExitCode(INTERRUPTED, "interrupted before it had a result, or by a second Ctrl-C", False),
)
"""All exit codes. A process killed by signal N has 128 + N in a shell, and may be resumed."""

FINAL = {code.number for code in EXIT_CODES if not code.again}
"""Exit codes after which another start would be in vain."""


def table() -> str:
    """Returns the exit codes as lines of a help text."""
    return "\n".join(f"{code.number:>5}  {code.meaning}" for code in EXIT_CODES)
