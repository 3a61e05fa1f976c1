"""`ReplayWatch`: what a learner knows of its replay, which tells it the steps that actors play."""

from contextlib import suppress
from pathlib import Path

from common.checked import MAX_COUNT
from common.errors import InputError
from common.protocol.run_keys import replay_of
from learner.phases import Phases
from replay.chunk_statistics import ReplayProgress
from replay.interface import Replay


class ReplayWatch:
    """Asks the replay for its counters, tells it the run's goal, and refuses a replay that has lost
    steps which the learner counts.

    Args:
        starts: agent steps of the warm-up; a replay that lacks more is refused.
        checkpoint: file with the network, to which errors refer.
    """

    progress: ReplayProgress
    """Its latest answer, from the first call of `look` on."""

    def __init__(
        self,
        replay: Replay,
        phases: Phases,
        *,
        starts: int,
        checkpoint: Path,
    ) -> None:
        self._replay = replay
        self._phases = phases
        self._starts = starts
        self._checkpoint = checkpoint

    @property
    def identity(self) -> str:
        """Identity of the replay, which a checkpoint keeps beside its counters."""
        return replay_of(self._replay.run_id)

    def check_identity(self, known: str) -> None:
        """Raises InputError unless the replay is the one that a checkpoint knows."""
        if known != self.identity:
            raise InputError(
                "the replay is not the one whose steps the checkpoint counts: "
                f"{self._instead_of_it}."
            )

    def look(self) -> ReplayProgress:
        """Returns what is new since the chunks that are counted, and keeps it as `progress`. Raises
        InputError if nothing can be drawn any more, or if the replay has lost counted steps."""
        goal = self._phases.steps_goal
        told = self._replay.progress(
            self._phases.chunks_seen, goal=MAX_COUNT if goal is None else goal
        )
        if told.failed:
            raise InputError(told.failed)
        known, found = self._phases.agent_steps, told.agent_steps
        # If many steps are missing, ε and the limiter start over, and actors play all of them again
        # before the next update. A power failure costs only a few steps.
        if known - found > self._starts:
            raise InputError(
                f"the replay has seen {found:,} steps and the learner {known:,}: "
                f"{self._instead_of_it}."
            )
        self.progress = told
        return told

    def look_once_more(self) -> None:
        """Looks, unless the replay is away."""
        with suppress(InputError):
            self.look()

    @property
    def stall_reason(self) -> str:
        """Why there is no progress, if there is none."""
        if self.progress.throttle and not self.progress.samplable:
            # Each stream of steps has a share of the ring, and its last n steps lack their future.
            return (
                f"none of the replay's {self.progress.stored:,} steps can be drawn, because too "
                "many environments share it: begin a run with more --replay.capacity, or a smaller "
                "--learning.n-step"
            )
        return "the logs of actors and replay say why"

    @property
    def _instead_of_it(self) -> str:
        return (
            "put the replay's folder back, or start another run with this one's network (--run "
            f"ANOTHER --initial {self._checkpoint})"
        )
