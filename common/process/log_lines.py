"""What a process says to people: as lines of JSON for programs that gather logs (``--log-json``),
and into a file of its run."""

import json
import logging
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import Any, TextIO

from common.process.output import silence
from common.regular_file import no_links
from common.strict_json import strict

_MOST_BYTES = 8 * 2**20
"""Size of a run's log, of which the one before is kept too: strangers may cause lines."""
_REPEAT = 10.0
"""Seconds after which the same is logged again."""
_MOST_SUBJECTS = 1_000
_role = ""
"""Who says it, once `say_json` was called."""


def say_json(role: str) -> None:
    """From now on `line` returns JSON, and so does what is logged."""
    global _role
    _role = role
    handler = logging.StreamHandler()
    handler.setFormatter(_Formatter(role))
    logging.basicConfig(handlers=[handler], force=True)


def line(
    text: str,
    level: str = "info",
    values: Mapping[str, Any] | None = None,
    *,
    stamped: bool = False,
) -> str:
    """Returns ``text`` as this process should write it: as it is, or as an object of JSON.

    Args:
        values: figures by their keys, which a line of JSON has too.
        stamped: whether the time of day, which a line of JSON always has, is before a plain one.
    """
    if _role:
        return as_json(_role, text, level, values)
    return f"{time.strftime('%H:%M:%S')} {text}" if stamped else text


def say(text: str, values: Mapping[str, Any] | None = None) -> None:
    """Print `line` at once; that nobody can read it is no reason to end."""
    write_line(line(text, values=values), sys.stdout)


def say_aside(text: str, level: str = "info") -> None:
    """As `say`, on standard error."""
    write_line(line(text, level), sys.stderr)


def write_line(text: str, stream: TextIO) -> None:
    """Print ``text`` as it is, at once; nothing more is printed where nobody reads it any more."""
    try:
        print(text, file=stream, flush=True)
    except OSError:
        silence(stream)


def as_json(role: str, text: str, level: str, values: Mapping[str, Any] | None = None) -> str:
    """Returns an object of JSON that says ``text``, and when."""
    now = time.time()
    stamp = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(now)) + f".{int(now % 1 * 1000):03}Z"
    told: dict[str, Any] = {"time": stamp, "level": level, "role": role, "message": text}
    if values is not None:
        told["values"] = strict(dict(values))
    return json.dumps(told, ensure_ascii=True, allow_nan=False)


class _Formatter(logging.Formatter):
    def __init__(self, role: str) -> None:
        super().__init__()
        self._role = role

    def format(self, record: logging.LogRecord) -> str:
        return as_json(self._role, super().format(record), record.levelname.lower())


class _KeptFile(RotatingFileHandler):
    def _open(self) -> TextIOWrapper:
        return open(self.baseFilename, "a", encoding="utf-8", opener=no_links)

    def handleError(self, record: logging.LogRecord) -> None:
        """A line that cannot be written is lost."""


@contextmanager
def kept_log(path: Path, role: str) -> Iterator[Callable[[str], None]]:
    """Appends all that is logged meanwhile to ``path``, as lines of JSON, and what the function
    that it returns is given. A disk without room costs lines, and nothing else."""
    root = logging.getLogger()
    # Python leaves its last resort, the terminal, out once there is another handler.
    terminal = None if root.handlers else logging.lastResort
    if terminal is not None:
        root.addHandler(terminal)
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
    file = _KeptFile(path, maxBytes=_MOST_BYTES, backupCount=1, delay=True)
    file.setFormatter(_Formatter(role))
    root.addHandler(file)

    def keep(text: str) -> None:
        file.handle(logging.makeLogRecord({"msg": text, "levelname": "INFO"}))

    try:
        yield keep
    finally:
        root.removeHandler(file)
        if terminal is not None:
            root.removeHandler(terminal)
        with suppress(OSError):
            file.close()


class Seldom(logging.Filter):
    """Passes warnings of one text about one subject, its first argument, at most once in `_REPEAT`
    seconds, however often clients ask again."""

    def __init__(self) -> None:
        super().__init__()
        self._said: dict[tuple[str, object], float] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        subject = record.args[0] if isinstance(record.args, tuple) and record.args else None
        said, now = (record.msg, subject), time.monotonic()
        if record.levelno > logging.WARNING:
            return True
        if now - self._said.get(said, -math.inf) < _REPEAT:
            return False
        if len(self._said) >= _MOST_SUBJECTS:
            self._said.clear()
        self._said[said] = now
        return True
