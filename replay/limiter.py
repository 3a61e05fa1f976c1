"""The rate limiter: bounds how far actors and learner may run ahead of each other.

The learner states at each draw how many steps it has drawn in the run, and the replay counts the
inserted steps. The limiter needs only these two numbers, so it has no state to checkpoint.
"""

from dataclasses import dataclass

from common.errors import InputError


@dataclass(frozen=True)
class RateLimiter:
    """Keeps draws near ``samples_per_insert`` per step inserted after ``learning_starts``."""

    samples_per_insert: float
    learning_starts: int
    """Steps before the first draw, which the ratio does not count."""
    tolerance: float
    """Maximum number of steps by which either side may be ahead."""
    batch_size: int

    def __post_init__(self) -> None:
        if not 0 < self.samples_per_insert < float("inf"):
            raise InputError(
                f"samples per insert is {self.samples_per_insert}: choose a positive number "
                "(it is batch_size / train_period)."
            )
        if self.learning_starts < 1:
            raise InputError(
                f"replay.learning_starts is {self.learning_starts}: nothing could be drawn; "
                "choose 1 or more."
            )
        if not self.tolerance * self.samples_per_insert >= self.batch_size:
            raise InputError(
                f"replay.ratio_tolerance is {self.tolerance} steps, less than the "
                f"{self.batch_size / self.samples_per_insert:g} that one minibatch stands for, so "
                "actors and learner would wait for each other for ever: raise it."
            )

    def deficit(self, inserted: int, drawn: int) -> float:
        """Returns the steps that are due to be drawn; negative if the learner is ahead."""
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
