"""`RunStatus`: a learner's answer to a query for the status of its run."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

from annotated_types import MaxLen
from pydantic import AllowInfNan

from common.checked import Amount, Count, Name, Rows
from common.errors import MessageError
from common.metrics import METRICS
from common.protocol.actor_stats import Role
from common.protocol.message import Message

MAX_ACTORS = 1_000
_Any = Annotated[float, AllowInfNan(True)]


class HealthCheck(NamedTuple):
    """The present result of a health check."""

    name: str
    value: _Any | None
    """None while it has not been measured."""
    bound: str
    """Bound on the value, such as ``≥ 0.99``."""
    passed: bool | None
    """None while it is unknown."""
    why: str
    """What a failure means, in one line."""
    stops: bool = True
    """Whether a run in which it keeps failing ends itself; see `learner.health_guard`."""


class ActorStatus(NamedTuple):
    """An actor or evaluator, as it last reported."""

    name: Name
    role: Role
    alive: bool
    leaving: bool
    """Whether it said that it leaves; if so, it is not lost when it is no longer alive."""
    silent_for: Amount
    """Seconds since its last report."""
    version: str
    steps_per_second: Amount
    lag: Count
    """Number of updates by which its weights are behind the newest."""
    throttled_share: Amount


@dataclass(frozen=True)
class RunStatus(Message):
    """The state of a run at one moment."""

    version: str
    """Version of the learner's software."""
    silent_for: Amount
    """Seconds since the training loop last made its periodic checks."""
    values: Annotated[dict[str, bool | int | _Any | str | None], MaxLen(1_000)]
    """Figures by their keys in `common.metrics`."""
    checks: Annotated[Rows[HealthCheck], MaxLen(1_000)]
    actors: Annotated[Rows[ActorStatus], MaxLen(MAX_ACTORS)]

    def check(self) -> None:
        """See `Message.check`: refuses a text where a figure is declared as a number."""
        for key, value in self.values.items():
            if isinstance(value, str) and key in METRICS and METRICS[key].form != "text":
                raise MessageError(f"{key} should be a number")
