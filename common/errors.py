"""Errors that are meant for people: one sentence, what is wrong and what to do."""

import errno
import sys
from collections.abc import Callable


class InputError(Exception):
    """The user asked for something that cannot be; its text is the whole message."""


class MessageError(ValueError):
    """A message from another process is malformed, oversized or for somebody else."""


def exit_on_input_error(main: Callable[[], int | None]) -> None:
    """Run ``main`` and exit with its status.

    An `InputError`, and a full disk wherever it was met, becomes one line and exit code 2.
    """
    try:
        status = main()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        status = 2
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        print(
            "error: the disk is full: free some space, then run the command again; "
            "a run goes on with --resume from its last checkpoint.",
            file=sys.stderr,
        )
        status = 2
    except KeyboardInterrupt:
        status = 130
    sys.exit(status)
