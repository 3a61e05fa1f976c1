"""What a learner tells whoever asks how its run does."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

from annotated_types import MaxLen
from pydantic import AllowInfNan

from common.checked import Amount, Count, Name, Rows
from common.protocol.actor_stats import Role
from common.protocol.message import Message

MOST_ACTORS = 1_000
_Any = Annotated[float, AllowInfNan(True)]


class HealthCheck(NamedTuple):
    """A condition without which learning cannot be trusted, as it is now."""

    name: str
    value: _Any | None
    """None while it has not been measured."""
    bound: str
    """What is asked of the value, such as ``≥ 0.99``."""
    passed: bool | None
    """None while that cannot be said."""
    why: str
    """One line: what a failure means."""
    stops: bool = True
    """A run in which it keeps failing ends by itself; see `learner.health_guard`."""


class ActorStatus(NamedTuple):
    """An actor or evaluator as it was last heard of."""

    name: Name
    role: Role
    alive: bool
    leaving: bool
    """It took its leave, so it is not lost where it is not alive."""
    silent_for: Amount
    """Seconds since it was last heard of."""
    version: str
    steps_per_second: Amount
    lag: Count
    """Updates by which its weights are behind the newest."""
    held_share: Amount


@dataclass(frozen=True)
class RunStatus(Message):
    """The run at this moment."""

    version: str
    """Version of the learner's software."""
    silent_for: Amount
    """Seconds since the training loop looked around."""
    values: Annotated[dict[str, bool | int | _Any | str | None], MaxLen(1_000)]
    """Figures by their keys in `common.metrics`."""
    checks: Annotated[Rows[HealthCheck], MaxLen(1_000)]
    actors: Annotated[Rows[ActorStatus], MaxLen(MOST_ACTORS)]
