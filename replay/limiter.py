"""The rate limiter: bounds how far actors and learner may run ahead of each other.

The learner states at each draw how many steps it has drawn in the run, and the replay counts the
inserted steps. The limiter needs only these two numbers, so it has no state to checkpoint.
"""

from dataclasses import dataclass

from common.settings.config import RunConfig


@dataclass(frozen=True)
class RateLimiter:
    """Keeps draws near ``samples_per_insert`` per step inserted after ``learning_starts``."""

    samples_per_insert: float
    learning_starts: int
    """Steps before the first draw, which the ratio does not count."""
    tolerance: float
    """Maximum number of steps by which either side may be ahead."""
    batch_size: int

    @classmethod
    def of(cls, config: RunConfig) -> "RateLimiter":
        """Returns the limiter of a run. `common.run.rules` refuses settings under which both sides
        would wait."""
        return cls(
            samples_per_insert=config.samples_per_insert,
            learning_starts=config.replay.learning_starts,
            tolerance=config.replay.ratio_tolerance,
            batch_size=config.learning.batch_size,
        )

    def deficit(self, inserted: int, drawn: int) -> float:
        """Returns the number of steps that are due to be drawn; negative if the learner is
        ahead."""
        return (inserted - self.learning_starts) * self.samples_per_insert - drawn

    def may_sample(self, inserted: int, drawn: int) -> bool:
        """Whether the learner may draw one more minibatch."""
        least = -self.tolerance * self.samples_per_insert
        return (
            inserted >= self.learning_starts
            and self.deficit(inserted, drawn) - self.batch_size >= least
        )

    def should_throttle(self, inserted: int, drawn: int) -> bool:
        """Whether actors must pause."""
        return self.deficit(inserted, drawn) > self.tolerance * self.samples_per_insert
