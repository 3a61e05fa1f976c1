"""`Replay`: the calls that a learner makes to a replay, local or remote."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from replay.batch import Batch
from replay.chunk_statistics import Progress


class Replay(Protocol):
    """A replay buffer, in this process or another. Its methods are thread-safe."""

    run_id: str
    """Identity of its run (`common.protocol.announcement.Announcement`)."""

    def sample(self, drawn: int, timeout: float) -> Batch | None:
        """Returns a minibatch, or None if none was available for ``timeout`` seconds.

        Args:
            drawn: steps that the learner has drawn so far in the run (batches × batch size), which
                the limiter needs.
            timeout: seconds to wait for actors that are behind.
        """

    def update_priorities(self, ids: NDArray[np.int64], priorities: NDArray[np.float32]) -> None:
        """Set priorities (≥ 0) of drawn steps; those of evicted steps are ignored.

        A priority that is not finite says that nothing can be learned from the step: until the
        replay's next start it is not drawn again, and the log names the actor that sent it.
        """

    def held_out(
        self, count: int, newest: int | None = None
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Returns states ``[N, H, 84, 84]`` and vectors ``[N, P]`` of N ≤ ``count`` distinct steps.

        All their frames are valid. They do not count as drawn.

        Args:
            newest: frames in the ring, the newest, among which to choose; None for all.
        """

    def progress(self, since: int, *, finished: bool | None = None) -> Progress:
        """The replay's counters, and the statistics of chunks from index ``since`` on.

        ``finished`` tells the actors, through their acknowledgements, whether the run is over; it
        holds until it is told otherwise. None asks only.
        """

    def drain(self) -> None:
        """Accept every chunk until the next draw, so that throttled actors can leave: they send
        their last chunks first."""

    def sync(self) -> None:
        """Have all that was acknowledged before on the replay's disk, if it can be reached."""

    def close(self) -> None:
        """Close the replay; waiting calls return."""
