"""Lines that a process prints: as plain text, as JSON for programs that gather logs
(``--log-json``), and into a file of its run."""

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

from common.process.output import silence, visible
from common.regular_file import no_links
from common.strict_json import strict

LOADING = "starting ... (loading PyTorch takes some seconds)"
"""Line of a program that has checked its flags."""
_MAX_BYTES = 8 * 2**20
"""Maximum size of a run's log, because strangers may cause lines; one earlier log is kept too."""
_REPEAT = 10.0
"""Seconds after which the same warning is logged again."""
_MAX_SUBJECTS = 1_000
_role = ""
"""The role in lines of JSON; empty until `say_json` is called."""


def say_json(role: str) -> None:
    """Makes `line` return JSON, and logging write JSON, from now on."""
    global _role
    _role = role
    handler = logging.StreamHandler()
    handler.setFormatter(_Formatter(role))
    logging.basicConfig(handlers=[handler], force=True)


def log_visibly() -> None:
    """Escapes control characters in what is logged to the terminal from now on. Names and keys that
    strangers chose are in some lines."""
    if logging.lastResort is not None:
        logging.lastResort.setFormatter(_Visible())


def line(
    text: str,
    level: str = "info",
    values: Mapping[str, Any] | None = None,
    *,
    stamped: bool = False,
) -> str:
    """Returns ``text`` as this process should write it: as it is, or as a JSON object.

    Args:
        values: figures by their keys; only a line of JSON has them.
        stamped: whether a plain line begins with the time of day; a line of JSON always has it.
    """
    if _role:
        return as_json(_role, text, level, values)
    return f"{time.strftime('%H:%M:%S')} {text}" if stamped else text


def say(text: str, values: Mapping[str, Any] | None = None) -> None:
    """Prints a `line` at once; the process goes on if nobody can read it."""
    write_line(line(text, values=values), sys.stdout)


def say_aside(text: str, level: str = "info") -> None:
    """Prints a `line` at once, on standard error."""
    write_line(line(text, level), sys.stderr)


def write_line(text: str, stream: TextIO) -> None:
    """Prints ``text`` as it is, at once. If nobody reads ``stream`` any more, it is silenced."""
    try:
        print(text, file=stream, flush=True)
    except OSError:
        silence(stream)


def as_json(role: str, text: str, level: str, values: Mapping[str, Any] | None = None) -> str:
    """Returns a JSON object with ``text`` and the time."""
    now = time.time()
    stamp = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(now)) + f".{int(now % 1 * 1000):03}Z"
    told: dict[str, Any] = {"time": stamp, "level": level, "role": role, "message": text}
    if values is not None:
        told["values"] = strict(dict(values))
    return json.dumps(told, ensure_ascii=True, allow_nan=False)


class _Visible(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return visible(super().format(record))


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
        """Does nothing: a line that cannot be written is lost."""


@contextmanager
def kept_log(path: Path, role: str) -> Iterator[Callable[..., None]]:
    """Appends lines of JSON to ``path``: all that is logged within the block, the error that ends
    it, and all texts given to the function that it yields, whose second argument is the level,
    "INFO" by default. If the disk is full, lines are lost and nothing else."""
    root = logging.getLogger()
    # Python drops its last resort, the terminal, once there is another handler.
    terminal = None if root.handlers else logging.lastResort
    if terminal is not None:
        root.addHandler(terminal)
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
    file = _KeptFile(path, maxBytes=_MAX_BYTES, backupCount=1, delay=True)
    file.setFormatter(_Formatter(role))
    root.addHandler(file)

    def keep(text: str, level: str = "INFO") -> None:
        file.handle(logging.makeLogRecord({"msg": text, "levelname": level}))

    try:
        yield keep
    except Exception as error:
        keep(str(error) or repr(error), "ERROR")
        raise
    finally:
        root.removeHandler(file)
        if terminal is not None:
            root.removeHandler(terminal)
        with suppress(OSError):
            file.close()


class Seldom(logging.Filter):
    """A filter that passes a warning about the same subject, its first argument, at most once in
    `_REPEAT` seconds, however often clients cause it."""

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
        if len(self._said) >= _MAX_SUBJECTS:
            self._said.clear()
        self._said[said] = now
        return True
