"""How far actors and learner may run ahead of each other.

The learner says at each draw how much it has drawn in all, and the replay knows how many steps
it was given; everything follows from these two numbers, so there is no state to checkpoint.
"""

from dataclasses import dataclass

from common.errors import InputError


@dataclass(frozen=True)
class RateLimiter:
    """Keeps draws near ``samples_per_insert`` for each step after the first ``learning_starts``
    ones."""

    samples_per_insert: float
    learning_starts: int
    """Steps that come before the first draw, and that the ratio does not count."""
    tolerance: float
    """Steps by which either side may be ahead."""
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
        """Draws that are due; negative when the learner is ahead."""
        return (inserted - self.learning_starts) * self.samples_per_insert - drawn

    def may_sample(self, inserted: int, drawn: int) -> bool:
        """Whether the learner may draw one more minibatch."""
        least = -self.tolerance * self.samples_per_insert
        return (
            inserted >= self.learning_starts
            and self.deficit(inserted, drawn) - self.batch_size >= least
        )

    def should_throttle(self, inserted: int, drawn: int) -> bool:
        """Whether actors should pause."""
        return self.deficit(inserted, drawn) > self.tolerance * self.samples_per_insert
