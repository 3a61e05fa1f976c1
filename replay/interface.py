"""`Replay`: the calls that a learner makes to a replay, local or remote."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from common.checked import MAX_COUNT
from replay.batch import Batch
from replay.chunk_statistics import ReplayProgress


class Replay(Protocol):
    """A replay buffer, in this process or another. Its methods are thread-safe."""

    run_id: str
    """Identity of its run (`common.run.announcement.Announcement`)."""

    def sample(self, drawn: int, timeout: float) -> Batch | None:
        """Returns a minibatch, or None if none was available for ``timeout`` seconds.

        Args:
            drawn: number of steps that the learner has drawn so far in the run (batches × batch
                size), which the limiter needs.
            timeout: seconds to wait for actors that are behind.
        """

    def update_priorities(self, ids: NDArray[np.int64], priorities: NDArray[np.float32]) -> None:
        """Sets the priorities (≥ 0) of drawn steps; evicted steps are ignored.

        A priority that is not finite says that nothing can be learned from the step. Such a step is
        not drawn again until the replay's next start, and the log names the actor that sent it.
        """

    def held_out(
        self, count: int, newest: int | None = None
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Returns states ``[N, H, 84, 84]`` and vectors ``[N, P]`` of N ≤ ``count`` distinct steps.

        All frames of the states are valid. The steps do not count as drawn.

        Args:
            newest: number of the ring's newest frames from which to choose; None for all.
        """

    def progress(self, since: int = MAX_COUNT, *, goal: int | None = None) -> ReplayProgress:
        """Returns the replay's counters, and the statistics of chunks from index ``since`` on, by
        default none.

        ``goal`` sets the number of agent steps with which the run is over, which acknowledgements
        then tell the actors; it stays until it is set again. None changes nothing.
        """

    def drain(self) -> None:
        """Accepts every chunk until the next draw, so that throttled actors can send their last
        chunks and leave."""

    def sync(self) -> None:
        """Puts all chunks acknowledged so far on the replay's disk, if the replay can be
        reached."""

    def close(self) -> None:
        """Closes the replay; waiting calls return."""
