"""The curves of a run for those who open its page later: at most so many points, evenly spread."""

from collections.abc import Iterable
from typing import Any

from common.metrics import Values, number
from common.strict_json import strict

_MOST = 1_000
"""Points; beyond these every second is dropped."""


class History:
    """Figures over agent steps.

    Args:
        keys: the figures that it keeps.
        most: number of points.
    """

    def __init__(self, keys: Iterable[str], most: int = _MOST) -> None:
        self._most = most
        self._every = 1
        self._offered = 0
        self._thinned = 0
        self._steps: list[int] = []
        self._values: dict[str, list[float | None]] = {key: [] for key in keys}

    def add(self, values: Values) -> None:
        """Take a point, unless it is one of those left out to make room for a long run."""
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
            self._thinned += 1

    def since(self, thinned: int, count: int) -> dict[str, Any]:
        """Returns the points after the first ``count``, of JSON's types; all of them where points
        were dropped since ``thinned`` was told."""
        start = count if thinned == self._thinned and 0 <= count <= len(self._steps) else 0
        return {
            "thinned": self._thinned,
            "start": start,
            "steps": self._steps[start:],
            "values": {key: curve[start:] for key, curve in self._values.items()},
        }
