"""The run at one moment, as every sink gets it: figures by key, actors, checks and notes."""

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
    """One actor or evaluator: its last counters, and whether it is alive."""

    stats: ActorStats
    alive: bool
    """Whether its liveliness token is present."""
    silent_for: float = 0.0
    """Seconds since it was last heard of."""
    left: bool = False
    """Whether it left a while ago, so that it is no longer shown but still counted."""


class Histogram(NamedTuple):
    """The number of values between each edge and the next."""

    counts: Sequence[int]
    edges: Sequence[float]
    """Edges of the bins, rising; one more than there are counts."""


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """The state of the run; everything that shows or writes figures takes them from here."""

    values: Values
    """Figures by their keys in `common.metrics`."""
    actors: tuple[ActorView, ...] = ()
    checks: tuple[HealthCheck, ...] = ()
    notes: tuple[str, ...] = ()
    """The latest events, newest last, such as "actor-2 was lost"."""
    rewards: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """Mean score of each epoch, oldest first, by phase: ``random``, ``train`` and ``test``."""
    histograms: Mapping[str, Histogram] = field(default_factory=dict)
    """Histograms by names like those of figures; those that are unknown yet are missing."""

    @property
    def present(self) -> tuple[ActorView, ...]:
        """The actors, without those that left a while ago."""
        return tuple(actor for actor in self.actors if not actor.left)

    @property
    def failed(self) -> tuple[HealthCheck, ...]:
        """The health checks that are red."""
        return tuple(check for check in self.checks if check.passed is False)

    @property
    def verdict(self) -> str:
        """The number of health checks of each colour: ``1 open, 6 green``."""
        colours = {False: "red", None: "open", True: "green"}
        counts = Counter(check.passed for check in self.checks)
        told = [
            f"{counts[passed]} {colour}" for passed, colour in colours.items() if counts[passed]
        ]
        return ", ".join(told) or "none yet"
