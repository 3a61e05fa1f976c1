"""Errors for people: one sentence that says what is wrong and what to do."""

import errno
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path

from common.exit_codes import BAD_INPUT, NO_ROOM, UNREACHABLE

NO_ROOM_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
"""Errors of a disk that is full or read-only, which may pass."""


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
    if isinstance(error, FileNotFoundError):
        return InputError(f"there is no {path}: name another file.")
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
