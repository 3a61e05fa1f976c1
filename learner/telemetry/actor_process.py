"""`ActorProcess`: what one process of an actor or evaluator says of itself, and what the replay has
of it."""

import math
from dataclasses import dataclass, replace

from common.protocol.actor_stats import ActorStats

LONGEST_DELAY = 5.0
"""Maximum number of seconds that a heartbeat is on its way."""


@dataclass
class ActorProcess:
    """One process of an actor or evaluator, from its start to its end. Times are monotonic
    seconds."""

    stats: ActorStats
    born: float
    """Time at which it was first mentioned."""
    heard: float
    """Time at which a heartbeat, a chunk or a checkpoint last mentioned it."""
    accepted: int = 0
    """Its chunks that the replay has stored."""
    known: int = 0
    """Accepted chunks that are so old that its counters must include them."""
    marked: tuple[float, int] = (-math.inf, 0)
    """Time of a recent moment, and the number of chunks accepted by then."""

    def hear(self, stats: ActorStats, now: float) -> None:
        """Takes in a heartbeat."""
        self.stats, self.heard = stats, now
        if now - self.marked[0] >= LONGEST_DELAY:
            self.known, self.marked = self.marked[1], (now, self.accepted)

    @property
    def made(self) -> int:
        """Chunks that it made; without a farewell, these may be more than its counters say."""
        stored = self.accepted + self.stats.refused
        return self.stats.made if self.stats.leaving else max(self.stats.made, stored)

    @property
    def excess(self) -> int:
        """Number of stored chunks beyond those that it says it made."""
        stored = self.accepted if self.stats.leaving else self.known
        return max(stored + self.stats.refused - self.stats.made, 0)

    @property
    def totals(self) -> ActorStats:
        """What it adds to the run's totals."""
        return replace(self.stats, made=self.made)
