"""What a learner asks of a replay, be it in its own process or behind Zenoh."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from replay.batch import Batch
from replay.chunk_statistics import Progress


class Replay(Protocol):
    """Safe to call from several threads."""

    def sample(self, drawn: int, timeout: float) -> Batch | None:
        """A minibatch, or None if there was none to be had for ``timeout`` seconds.

        Args:
            drawn: steps that the learner has drawn so far in the run (batches × batch size);
                the limiter rests on it.
            timeout: how long to wait for actors that are behind, in seconds.
        """

    def update_priorities(self, ids: NDArray[np.int64], priorities: NDArray[np.float32]) -> None:
        """New priorities (≥ 0) of drawn steps; those of evicted ones are passed over."""

    def held_out(self, count: int) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """States ``[N, H, 84, 84]`` and vectors ``[N, P]`` of N ≤ ``count`` different steps.

        All their frames were valid; they do not count as drawn.
        """

    def progress(self, since: int, *, finished: bool | None = None) -> Progress:
        """The replay's counters, and the facts of chunks from index ``since`` on.

        ``finished`` tells the actors, through their acknowledgements, whether the run is over; it
        holds until it is told otherwise. None asks only.
        """

    def close(self) -> None:
        """Let go; waiting calls return."""
