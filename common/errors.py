"""Errors for people: one sentence that says what is wrong and what to do."""

import atexit
import errno
import gc
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path

from common.process.exit_codes import BAD_INPUT, FAILED, INTERRUPTED, NO_ROOM, UNREACHABLE
from common.process.log_lines import log_visibly, say_aside
from common.process.output import escape, has_reader, open_closed, silence, visible, widen

NO_ROOM_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
"""Errors of a disk that is full or read-only, which may pass."""
_SHORT_ERRORS = (errno.EMFILE, errno.ENFILE, errno.ENOMEM)
"""Errors of a process that runs out of files or memory; a new process has enough of both."""
_UNREACHED = (errno.EHOSTUNREACH, errno.ENETUNREACH, errno.ENETDOWN)
"""Errors of a network, beside ConnectionError and TimeoutError; a new process connects anew."""


class InputError(Exception):
    """An invalid request of the user; its text is the whole message that the user reads."""

    def __init__(self, text: str, exit_code: int = BAD_INPUT) -> None:
        super().__init__(text)
        self.exit_code = exit_code


class Unreachable(InputError):
    """No process answers at an address, or the run there has gone: another try may succeed."""

    def __init__(self, text: str) -> None:
        super().__init__(text, UNREACHABLE)


def cannot_write(path: Path, error: OSError) -> InputError:
    """Returns the error that says that ``path`` cannot be written."""
    code = NO_ROOM if error.errno in NO_ROOM_ERRORS else BAD_INPUT
    told = f"{path} cannot be written ({error.strerror}): name another place, or mend this one."
    return InputError(told, code)


def cannot_read(path: Path, error: Exception) -> InputError:
    """Returns the error that says that ``path`` cannot be read, or what is wrong in it."""
    why = error.strerror if isinstance(error, OSError) else error
    return InputError(f"{path} cannot be read ({why}): mend this file, or name another.")


def choice(given: str, known: Sequence[str], otherwise: str | None = None) -> str:
    """Returns the end of a sentence that refuses ``given``: the name that was probably meant, or
    ``otherwise``, which by default lists the known names."""
    if alike := get_close_matches(given, known, n=1):
        return f"did you mean {alike[0]}?"
    return f"choose one of {', '.join(known)}." if otherwise is None else otherwise


class MessageError(ValueError):
    """A message from another process is malformed, too large or meant for another process."""


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Raises InputError if the system refuses a write to ``path`` within the block."""
    try:
        yield
    except OSError as error:
        raise cannot_write(path, error) from None


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
    # All memory goes with the process: to look through PyTorch's objects for cycles, as Python does
    # at its end, takes a second in which nothing else happens.
    atexit.register(gc.freeze)
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
            what = "the disk is full: free some space"
        told = "then run the command again; --resume continues a run from its last checkpoint."
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
