"""Ends an unhealthy run, so that nobody finds out after a week that it was blind, or stood still.

A run ends for one of two reasons:

- A health check is red without interruption for ``--gate-minutes`` of the learner's own work, and
  for so many agent steps that the fault itself lasted for half of them. The other half may be only
  its trace in the means over the newest steps.
- ``--stall-minutes`` pass without an agent step or update, once there has been one. A learner that
  still waits for its first actors is healthy.

A healthy run is never ended.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from common.protocol.run_status import HealthCheck
from common.schedule import Now
from learner.phases import JUDGED_CHUNKS
from learner.telemetry import formats

_LONGEST_LOOK = 2.0
"""Maximum number of seconds that count between two looks. The learner looks four times a second: if
more time has passed, the machine was suspended, or training waited for room on the disk."""


@dataclass
class HealthGuard:
    """Decides when a run should end; with ``force`` it only warns, once for each reason."""

    red_minutes: float
    """Minutes for which a check that ends runs may be red."""
    stall_minutes: float
    """Minutes that may pass without an agent step or update."""
    chunk_steps: int
    force: bool
    warn: Callable[[str], None]
    """Takes a sentence for people."""
    now: Now

    def __post_init__(self) -> None:
        self._red_steps = 2 * JUDGED_CHUNKS * self.chunk_steps
        self._warned: set[str] = set()
        self._looked = self.now()
        self._worked = 0.0
        """Seconds of work so far; all other times are measured in them."""
        self._red_since: dict[str, tuple[float, int]] = {}
        """Seconds of work and agent steps at which each red check became red."""
        self._progress: tuple[int, int] | None = None
        self._moved_at: float | None = None
        """Seconds of work at the last step or update; None before the first."""

    def check(
        self,
        checks: Sequence[HealthCheck],
        agent_steps: int,
        updates: int,
        hint: str,
    ) -> str | None:
        """Returns why the run should end, without a full stop; None while it may go on.

        Args:
            checks: the health checks; none in the warm-up, when they are not judged.
            hint: why there is no progress, if there is none.
        """
        now = self.now()
        self._worked += min(now - self._looked, _LONGEST_LOOK)
        self._looked = now
        for name, reason in (
            *self._red(checks, agent_steps),
            *self._stall(agent_steps, updates, hint),
        ):
            if not self.force:
                return reason
            if name not in self._warned:
                self._warned.add(name)
                self.warn(f"WARNING: {reason}; training continues because of --force.")
        return None

    def _red(self, checks: Sequence[HealthCheck], agent_steps: int) -> Iterator[tuple[str, str]]:
        """Yields name and verdict of each check that has been red for too long."""
        red = [check for check in checks if check.stops and check.passed is False]
        this_look = self._worked, agent_steps
        self._red_since = {check.name: self._red_since.get(check.name, this_look) for check in red}
        for check in red:
            seconds, steps = self._red_since[check.name]
            long = self._worked - seconds >= 60 * self.red_minutes
            if long and agent_steps - steps >= self._red_steps:
                yield (
                    check.name,
                    f"health check {check.name!r} has been red for {self.red_minutes:g} minutes "
                    f"and {self._red_steps:,} steps: it is {formats.reading_and_bound(check)}, "
                    f"so {check.why}",
                )

    def _stall(self, agent_steps: int, updates: int, hint: str) -> Iterator[tuple[str, str]]:
        """Yields name and reason if there has been no progress for too long."""
        before, self._progress = self._progress, (agent_steps, updates)
        if before is not None and before != self._progress:
            self._moved_at = self._worked
        if self._moved_at is not None and self._worked - self._moved_at >= 60 * self.stall_minutes:
            yield (
                "progress",
                f"no agent step came and no update was made for {self.stall_minutes:g} "
                f"minutes: {hint}",
            )
