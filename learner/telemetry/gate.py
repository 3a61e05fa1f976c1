"""Ends a run whose health checks keep failing: nobody shall find after a week that it was blind.

A healthy run is never ended: a check must fail without interruption for `MINUTES` of the
learner's own work, and for so many agent steps that the fault itself, and not only its trace in
the means over the newest steps, lasted for half of them.
"""

import time
from collections.abc import Callable, Iterable
from typing import NamedTuple

from learner.telemetry.run_progress import JUDGED_CHUNKS
from learner.telemetry.sinks import formats
from learner.telemetry.snapshot import HealthCheck

MINUTES = 5.0
EXIT_CODE = 3
"""Exit code of a learner that a gate ended."""
_LONGEST_LOOK = 2.0
"""Seconds between two looks that count at most. The learner looks four times a second: if more has
passed, it was suspended, or the machine was."""


def least_steps(chunk_steps: int) -> int:
    """Agent steps for which a check must fail: 10,240 with chunks of 64."""
    return 2 * JUDGED_CHUNKS * chunk_steps


class _Failing(NamedTuple):
    """How long a check has failed."""

    seconds: float
    since_steps: int


class GateWatch:
    """Times how long health checks have failed.

    Args:
        seconds, steps: for which a check must fail without interruption.
        clock: monotonic seconds.
    """

    def __init__(
        self, seconds: float, steps: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._seconds = seconds
        self._steps = steps
        self._clock = clock
        self._looked = clock()
        self._failing: dict[str, _Failing] = {}

    def look(self, checks: Iterable[HealthCheck], agent_steps: int) -> HealthCheck | None:
        """Take in the checks as they are; returns one that has failed for too long, if any."""
        now = self._clock()
        passed = min(now - self._looked, _LONGEST_LOOK)
        self._looked = now
        before, self._failing = self._failing, {}
        found = None
        for check in checks:
            if not check.stops or check.passed is not False:
                continue
            seconds, since = before.get(check.name, _Failing(-passed, agent_steps))
            self._failing[check.name] = failing = _Failing(seconds + passed, since)
            if failing.seconds >= self._seconds and agent_steps - since >= self._steps:
                found = found or check
        return found


def verdict(check: HealthCheck, seconds: float, steps: int) -> str:
    """What is wrong with a run whose ``check`` failed for so long, without a full stop."""
    return (
        f"gate {check.name!r} has been red for {seconds / 60:g} minutes and {steps:,} steps: it is "
        f"{formats.significant(check.value)}, not {check.bound}, so {check.why}"
    )
