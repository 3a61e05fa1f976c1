"""Ends a run in which a gate stays red: nobody shall find after a week that the robot was blind.

A healthy run is never ended: a gate must be red without interruption for `MINUTES` of the
learner's own work, and for so many agent steps that the fault itself, and not only its trace in
the means over the newest steps, lasted for half of them.
"""

import time
from collections.abc import Callable, Iterable
from typing import NamedTuple

from learner.telemetry.run_progress import JUDGED_CHUNKS
from learner.telemetry.sinks import formats as figures
from learner.telemetry.status import Gate

MINUTES = 5.0
EXIT_CODE = 3
"""Of a learner that ended because of a gate."""
_LONGEST_LOOK = 2.0
"""Seconds between two looks that count at most. The learner looks four times a second: if more has
passed, it was suspended, or the machine was."""


def least_steps(chunk_steps: int) -> int:
    """Agent steps that a gate must be red for: 10,240 with chunks of 64."""
    return 2 * JUDGED_CHUNKS * chunk_steps


class _Red(NamedTuple):
    """How long a gate has been red."""

    seconds: float
    since_steps: int


class GateWatch:
    """Times how long gates have been red.

    Args:
        seconds: and
        steps: for which a gate must be red without interruption.
        clock: monotonic seconds.
    """

    def __init__(
        self, seconds: float, steps: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._seconds = seconds
        self._steps = steps
        self._clock = clock
        self._looked = clock()
        self._red: dict[str, _Red] = {}

    def look(self, gates: Iterable[Gate], agent_steps: int) -> Gate | None:
        """Take in the gates as they are; one that has been red for too long, if there is any."""
        now = self._clock()
        passed = min(now - self._looked, _LONGEST_LOOK)
        self._looked = now
        before, self._red = self._red, {}
        found = None
        for gate in gates:
            if not gate.stops or gate.passed is not False:
                continue
            seconds, since = before.get(gate.name, _Red(-passed, agent_steps))
            self._red[gate.name] = red = _Red(seconds + passed, since)
            if red.seconds >= self._seconds and agent_steps - since >= self._steps:
                found = found or gate
        return found


def verdict(gate: Gate, seconds: float, steps: int) -> str:
    """What is wrong with a run whose ``gate`` has been red for so long, without a full stop."""
    return (
        f"gate {gate.name!r} has been red for {seconds / 60:g} minutes and {steps:,} steps: it is "
        f"{figures.significant(gate.value)}, not {gate.bound}, so {gate.why}"
    )
