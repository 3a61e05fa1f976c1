"""The curves of a run so far, for browsers that open its page later, in a bounded number of
points."""

import secrets
from collections.abc import Iterable
from typing import Any

from common.metrics import Values, number
from common.strict_json import strict

_MOST = 1_000
"""Maximum number of points; if there are more, every second one is dropped."""


class History:
    """Figures over agent steps, at evenly spread points.

    Args:
        keys: the figures to keep.
        most: maximum number of points.
    """

    def __init__(self, keys: Iterable[str], most: int = _MOST) -> None:
        self._most = most
        self._every = 1
        self._offered = 0
        self._version = secrets.randbelow(10**8)
        """Changes when points are dropped, and differs from that of the page of another process."""
        self._steps: list[int] = []
        self._values: dict[str, list[float | None]] = {key: [] for key in keys}

    def add(self, values: Values) -> None:
        """Adds a point, unless it is one of those that a long run leaves out."""
        self._offered += 1
        if (self._offered - 1) % self._every:
            return
        self._steps.append(int(number(values, "run/agent_steps") or 0))
        for key, curve in self._values.items():
            curve.append(strict(number(values, key)))
        if len(self._steps) > self._most:
            del self._steps[1::2]
            for curve in self._values.values():
                del curve[1::2]
            self._every *= 2
            self._version += 1

    def since(self, version: int, count: int) -> dict[str, Any]:
        """Returns the points after the first ``count``, of JSON's types.

        If the caller has points of another ``version``, all points are returned.
        """
        start = count if version == self._version and 0 <= count <= len(self._steps) else 0
        return {
            "version": self._version,
            "start": start,
            "steps": self._steps[start:],
            "values": {key: curve[start:] for key, curve in self._values.items()},
        }
