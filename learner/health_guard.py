"""Ends a run that is not healthy: a gate stays red, or no progress is made."""

from collections.abc import Callable, Sequence

from learner.telemetry.gate import GateWatch, least_steps, verdict
from learner.telemetry.snapshot import HealthCheck

STALL_MINUTES = 10.0


class HealthGuard:
    """Says once why a run should end; with ``force`` it only warns.

    Args:
        gate_minutes: minutes for which a gate may be red.
        stall_minutes: minutes in which neither an agent step nor an update may come, once there
            has been one; a learner whose actors are still to be started is in good health.
        chunk_steps: agent steps of a chunk.
        warn: takes a sentence for people.
        now: monotonic seconds. Time in which nobody asks does not count: the machine was
            suspended, or training waited for room on the disk.
    """

    def __init__(
        self,
        gate_minutes: float,
        stall_minutes: float,
        chunk_steps: int,
        *,
        force: bool,
        warn: Callable[[str], None],
        now: Callable[[], float],
    ) -> None:
        self._seconds = 60 * gate_minutes
        self._steps = least_steps(chunk_steps)
        self._gates = GateWatch(self._seconds, self._steps, now)
        self._stall_minutes = stall_minutes
        self._stalls = GateWatch(60 * stall_minutes, 0, now)
        self._force = force
        self._warn = warn
        self._warned: set[str] = set()
        self._last: tuple[int, int] | None = None
        self._moved = False

    def check(self, checks: Sequence[HealthCheck], agent_steps: int, updates: int) -> str | None:
        """Returns why the run should end, without a full stop; None while it may go on.

        Args:
            checks: none while they are not to be judged, in the warm-up.
        """
        reasons = []
        if (gate := self._gates.look(checks, agent_steps)) is not None:
            reasons.append((gate.name, verdict(gate, self._seconds, self._steps)))
        if self._stalls.look((self._progress(agent_steps, updates),), agent_steps) is not None:
            reasons.append(
                (
                    "progress",
                    f"no agent step came and no update was made for {self._stall_minutes:g} "
                    "minutes: the logs of actors and replay say why",
                )
            )
        for name, reason in reasons:
            if not self._force:
                return reason
            if name not in self._warned:
                self._warned.add(name)
                self._warn(f"WARNING: {reason}; training continues because of --force.")
        return None

    def _progress(self, agent_steps: int, updates: int) -> HealthCheck:
        """The check that fails while steps and updates stand still."""
        before, self._last = self._last, (agent_steps, updates)
        moved = before is not None and before != self._last
        self._moved |= moved
        passed = moved if self._moved else None
        return HealthCheck(name="progress", value=float(moved), passed=passed, bound="= 1", why="")
