"""How a program ends: what went wrong becomes one line on stderr and an exit code."""

import errno
import signal
import sys
from collections.abc import Callable

from common.errors import NO_ROOM_ERRORS, InputError
from common.exit_codes import BAD_INPUT, FAILED, INTERRUPTED, NO_ROOM
from common.process.log_lines import log_visibly, say_aside
from common.process.output import escape, has_reader, open_closed, silence, visible, widen

_SHORT_ERRORS = (errno.EMFILE, errno.ENFILE, errno.ENOMEM)
"""Errors of a process that runs out of files or memory; a new process has enough of both."""
_UNREACHED = (errno.EHOSTUNREACH, errno.ENETUNREACH, errno.ENETDOWN)
"""Errors of a network, beside ConnectionError and TimeoutError; a new process connects anew."""


def exit_on_input_error(main: Callable[[], int | None]) -> None:
    """Runs ``main`` and exits with its status.

    An `InputError` or `OSError` becomes one line on stderr, and an exit code of `EXIT_CODES`. A
    program whose output is no longer read, as before ``| head``, ends in silence.
    """
    status: int | str | None
    open_closed()
    escape(sys.stdout)
    widen()
    log_visibly()
    try:
        try:
            status = main()
        except SystemExit as end:  # as after --help
            status = end.code
        sys.stdout.flush()
    except InputError as error:
        say_aside(f"error: {visible(str(error))}", "error")
        status = error.exit_code
    except OSError as error:
        if isinstance(error, BrokenPipeError) and not has_reader(sys.stdout):
            silence(sys.stdout)
            sys.exit(128 + signal.SIGPIPE)
        what = f"{error.filename or 'the system'}: {error.strerror or error}: fix that"
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            of = "" if error.filename is None else f" of {error.filename}"
            what = f"the disk{of} is full: free some space"
        elif error.errno == errno.EFBIG:
            what = "a file would exceed the limit of its size (ulimit -f): raise the limit"
        told = "then run the command again, that of a run with --resume."
        say_aside(f"error: {what}, {told}", "error")
        if error.errno in NO_ROOM_ERRORS:
            status = NO_ROOM
        else:
            # As when an environment loses its real robot: its actor is started again.
            lost = isinstance(error, ConnectionError | TimeoutError)
            again = lost or error.errno in (*_SHORT_ERRORS, *_UNREACHED)
            status = FAILED if again else BAD_INPUT
    except KeyboardInterrupt:
        status = INTERRUPTED
    sys.exit(status)
