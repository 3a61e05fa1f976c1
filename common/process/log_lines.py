"""``--log-json``: what a process says to people, as lines of JSON for programs that gather logs."""

import json
import logging
import time
from collections.abc import Mapping
from typing import Any

from common.strict_json import strict

_role = ""
"""Who says it, once `say_json` was called."""


def say_json(role: str) -> None:
    """From now on `line` returns JSON, and so does what is logged."""
    global _role
    _role = role
    handler = logging.StreamHandler()
    handler.setFormatter(_Formatter())
    logging.basicConfig(handlers=[handler], force=True)


def line(text: str, level: str = "info", values: Mapping[str, Any] | None = None) -> str:
    """Returns ``text`` as this process should write it: as it is, or as an object of JSON.

    Args:
        values: figures by their keys, which a line of JSON has too.
    """
    if not _role:
        return text
    now = time.time()
    stamp = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(now)) + f".{int(now % 1 * 1000):03}Z"
    told: dict[str, Any] = {"time": stamp, "level": level, "role": _role, "message": text}
    if values is not None:
        told["values"] = strict(dict(values))
    return json.dumps(told, ensure_ascii=True, allow_nan=False)


class _Formatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return line(super().format(record), record.levelname.lower())
