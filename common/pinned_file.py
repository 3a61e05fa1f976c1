"""Files that a run's settings name together with the hash of their content: ``PATH#sha256=HASH``.

The content does not travel with the settings: it is hundreds of times as long, every process of a
run and every card of a policy would carry it, and only its owner may hand it on. The hash ensures
that each process plays with the same content, or says what it lacks.
"""

import hashlib
from pathlib import Path

from common.checked import MAX_TEXT
from common.errors import InputError
from common.regular_file import read_file

MAX_BYTES = 2**26
"""Maximum size of such a file, bytes."""
_MARK = "#sha256="


def path_of(name: str) -> Path:
    """Returns the path in ``name``, without the hash if it has one."""
    return Path(name.partition(_MARK)[0])


def with_hash(name: str, sha256: str) -> str:
    """Returns ``name`` with the hash of its content."""
    return f"{name}{_MARK}{sha256}"


def pin(name: str) -> str:
    """Returns ``name`` with the hash of the file's present content, or unchanged if it has a hash.
    Raises InputError as `read` does, and if the path is too long to travel with the hash."""
    if _MARK in name:
        return name
    pinned = with_hash(name, hashlib.sha256(read(name)).hexdigest())
    if (over := len(pinned) - MAX_TEXT) > 0:
        raise InputError(
            f"the path {name} is too long by {over} characters for a run's settings: name the "
            "file by a shorter path."
        )
    return pinned


def read(name: str) -> bytes:
    """Returns the content of the file ``name``. Raises InputError if it cannot be read, is larger
    than `MAX_BYTES`, or does not have the hash in ``name``."""
    path, (_, _, wanted) = path_of(name), name.partition(_MARK)
    try:
        content = read_file(path, MAX_BYTES + 1)
    except ValueError as error:
        raise InputError(f"{path} cannot be read ({error}): name another file.") from None
    except OSError as error:
        advice = "copy it there from where the run began" if wanted else "name a file that is there"
        raise InputError(f"{path} cannot be read ({error.strerror}): {advice}.") from None
    if len(content) > MAX_BYTES:
        raise InputError(f"{path} is larger than {MAX_BYTES:,} bytes: name a smaller file.")
    found = hashlib.sha256(content).hexdigest()
    if wanted and found != wanted:
        raise InputError(
            f"{path} is not the run's file: its SHA-256 is {found}, the run's {wanted}: copy the "
            "file there from where the run began."
        )
    return content
