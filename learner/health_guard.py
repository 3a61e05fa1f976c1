"""Ends a run that is not healthy: nobody shall find after a week that it was blind, or stood still.

A healthy run is never ended. A health check must be red without interruption for `RED_MINUTES` of
the learner's own work, and for so many agent steps that the fault itself, and not only its trace in
the means over the newest steps, lasted for half of them. Nor may `STALL_MINUTES` pass without any
agent step or update, once there has been one; a learner whose actors are still to be started is
in good health.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from common.protocol.run_status import HealthCheck
from learner.phases import JUDGED_CHUNKS
from learner.telemetry.sinks import formats

RED_MINUTES = 5.0
STALL_MINUTES = 10.0
_LONGEST_LOOK = 2.0
"""Seconds between two looks that count at most. The learner looks four times a second: if more has
passed, the machine was suspended, or training waited for room on the disk."""


@dataclass
class HealthGuard:
    """Says why a run should end; with ``force`` it only warns, once for each reason."""

    red_minutes: float
    """Minutes for which a check that stops a run may be red."""
    stall_minutes: float
    """Minutes in which neither an agent step nor an update may come."""
    chunk_steps: int
    force: bool
    warn: Callable[[str], None]
    """Takes a sentence for people."""
    now: Callable[[], float]
    """Monotonic seconds."""

    def __post_init__(self) -> None:
        self._red_steps = 2 * JUDGED_CHUNKS * self.chunk_steps
        self._warned: set[str] = set()
        self._looked = self.now()
        self._worked = 0.0
        """Seconds of work so far, by which all else is timed."""
        self._red_since: dict[str, tuple[float, int]] = {}
        """Seconds of work and agent steps at which each check that is red became so."""
        self._progress: tuple[int, int] | None = None
        self._moved_at: float | None = None
        """Seconds of work at the last step or update that came; None before the first."""

    def check(self, checks: Sequence[HealthCheck], agent_steps: int, updates: int) -> str | None:
        """Returns why the run should end, without a full stop; None while it may go on.

        Args:
            checks: none while they are not to be judged, in the warm-up.
        """
        now = self.now()
        self._worked += min(now - self._looked, _LONGEST_LOOK)
        self._looked = now
        for name, reason in (*self._red(checks, agent_steps), *self._stall(agent_steps, updates)):
            if not self.force:
                return reason
            if name not in self._warned:
                self._warned.add(name)
                self.warn(f"WARNING: {reason}; training continues because of --force.")
        return None

    def _red(self, checks: Sequence[HealthCheck], agent_steps: int) -> Iterator[tuple[str, str]]:
        """Yields name and verdict of each check that was red for too long."""
        red = [check for check in checks if check.stops and check.passed is False]
        this_look = self._worked, agent_steps
        self._red_since = {check.name: self._red_since.get(check.name, this_look) for check in red}
        for check in red:
            seconds, steps = self._red_since[check.name]
            long = self._worked - seconds >= 60 * self.red_minutes
            if long and agent_steps - steps >= self._red_steps:
                value = formats.written("significant", check.value)
                yield (
                    check.name,
                    f"health check {check.name!r} has been red for {self.red_minutes:g} minutes "
                    f"and {self._red_steps:,} steps: it is {value}, not {check.bound}, so "
                    f"{check.why}",
                )

    def _stall(self, agent_steps: int, updates: int) -> Iterator[tuple[str, str]]:
        """Yields the reason if nothing has come for too long."""
        before, self._progress = self._progress, (agent_steps, updates)
        if before is not None and before != self._progress:
            self._moved_at = self._worked
        if self._moved_at is not None and self._worked - self._moved_at >= 60 * self.stall_minutes:
            yield (
                "progress",
                f"no agent step came and no update was made for {self.stall_minutes:g} "
                "minutes: the logs of actors and replay say why",
            )
