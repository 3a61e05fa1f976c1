"""The run at one moment, as every sink gets it: figures by key, and what is not a number."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from common.metrics import Values
from common.protocol.actor_stats import ActorStats
from common.protocol.run_status import HealthCheck

Phase = Literal["warm-up", "training", "finishing"]


@dataclass(frozen=True, kw_only=True)
class ActorView:
    """One actor or evaluator: what it last told, and whether it is there."""

    stats: ActorStats
    alive: bool
    """Its liveliness token is there."""
    silent_for: float = 0.0
    """Seconds since it was last heard of."""
    left: bool = False
    """It took its leave a while ago: no longer shown, still counted."""


class Histogram(NamedTuple):
    """How often values were found between each edge and the next."""

    counts: Sequence[int]
    edges: Sequence[float]
    """Rising; one more than there are counts."""


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """The run now; whoever shows or writes figures takes them from here and nowhere else."""

    values: Values
    """Figures by their keys in `common.metrics`."""
    actors: tuple[ActorView, ...] = ()
    checks: tuple[HealthCheck, ...] = ()
    notes: tuple[str, ...] = ()
    """The latest events, newest last, such as "actor-2 was lost"."""
    rewards: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """Mean score of each epoch, oldest first, by phase: ``random``, ``train`` and ``test``."""
    histograms: Mapping[str, Histogram] = field(default_factory=dict)
    """By names as those of figures; none of what is not known yet."""

    @property
    def present(self) -> tuple[ActorView, ...]:
        """The actors without those that took their leave a while ago."""
        return tuple(actor for actor in self.actors if not actor.left)

    @property
    def failed(self) -> tuple[HealthCheck, ...]:
        """The health checks that were measured and did not pass."""
        return tuple(check for check in self.checks if check.passed is False)

    @property
    def verdict(self) -> str:
        """How many health checks there are of each colour: ``1 open, 6 green``."""
        colours = {False: "red", None: "open", True: "green"}
        counts = Counter(check.passed for check in self.checks)
        told = [
            f"{counts[passed]} {colour}" for passed, colour in colours.items() if counts[passed]
        ]
        return ", ".join(told) or "none yet"
