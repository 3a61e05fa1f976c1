"""`ActorStats`: an actor's report about itself, once a second and when it leaves.

A counter is declared once, as a field of `ActorStats`. The actor adds to it, the message carries
it, the learner's registry sums it over all processes of the run, and `common.metrics` has the total
in its table of figures.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from common.checked import Amount, Count, Name, Values
from common.errors import MessageError
from common.press_latency import COUNTS
from common.protocol.message import Message
from common.version import VERSION

Role = Literal["actor", "evaluator"]
MAX_HEARTBEATS = 100
"""Maximum per second and process; a hub drops a heartbeat that follows another too soon."""


def counter(key: str, unit: str, meaning: str, **shown: Any) -> Any:
    """Returns a field that counts from the start of the process. Its total over all processes is
    the figure ``key``, with ``shown`` as further fields of its `common.metrics.Metric`."""
    return field(default=0, metadata={"key": key, "unit": unit, "meaning": meaning, **shown})


# fmt: off
# ruff: noqa: RUF009  # `counter` gives fields, not values
@dataclass
class ActorStats(Message):
    """Counters of one actor process since its start."""

    name: Name
    role: Role
    incarnation: Count = 0
    """Number that differs for each start of the process, and grows."""
    leaving: bool = False
    """Whether this is the last message of the process."""
    steps: Count = counter("actors/steps", "steps", "Agent steps of actors and evaluators")
    steps_per_second: Amount = 0.0
    """Agent steps per second of the last ten seconds, as are all its rates."""
    epsilon: Amount = 0.0
    weights_version: Count = 0
    made: Count = counter(
        "stream/chunks_made", "chunks",
        "Chunks that actors made; in the end, all are accepted or refused",
        label="made", panel=("Stream", 7), curve=True, summary="chunks.made")
    acked: Count = counter("actors/acked", "chunks", "Chunks that actors know were accepted")
    retried: Count = counter(
        "stream/chunks_retried", "chunks", "Chunks that actors sent again",
        label="retried", panel=("Stream", 5), curve=True, summary="chunks.retried")
    refused: Count = counter("actors/refused", "chunks", "Chunks that actors know were refused")
    throttled_share: Amount = 0.0
    """Share of time for which it paused because the learner was behind."""
    valid: Count = counter("actors/valid", "steps", "Steps whose frame showed the game")
    matched: Count = counter("actors/matched", "steps", "Steps that ended with the commanded keys")
    decisions: Count = counter("actors/elapsed", "steps", "Agent steps of game time that passed")
    missed_deadlines: Count = counter(
        "actors/missed_deadlines", "steps",
        "In real time: agent steps that began without their command, or had a late frame",
        summary="missed_deadlines", trouble="late")
    late_frames: Count = counter(
        "actors/late_frames", "frames",
        "In real time: emulator frames that began more than one frame late",
        summary="late_frames", trouble="late")
    waits_given_up: Count = counter(
        "actors/waits_given_up", "steps",
        "Steps whose wait for the commanded keys reached its bound",
        summary="waits_given_up", trouble="gave up")
    version: str = VERSION
    """Version of its software."""
    key_times: Values[Count] = ()
    """Latency of the hands, as counts (see `common.press_latency`); empty if it is unknown."""
    machine: str = ""
    """Name of its host."""
    seconds: Amount = 0.0
    """Seconds since its start."""
    busy_cores: Amount = 0.0
    """Recent processor time, in seconds per second."""
    memory_bytes: Count = 0
    """Its memory, without file pages."""
    run_id: str = ""
    """Identity of its run."""
# fmt: on

    @property
    def valid_share(self) -> float:
        """Share of its steps whose frame showed the game."""
        return self.valid / max(self.steps, 1)

    @property
    def match_share(self) -> float:
        """Share of its steps that ended with the commanded keys pressed."""
        return self.matched / max(self.steps, 1)

    def check(self) -> None:
        if len(self.key_times) not in (0, COUNTS):
            raise MessageError(f"key_times should be {COUNTS} counts, or none")


COUNTERS: dict[str, Mapping[str, Any]] = {
    each.name: each.metadata for each in dataclasses.fields(ActorStats) if each.metadata
}
"""What each counter's declaration says of its total."""
TOTALS: dict[str, str] = {name: declared["key"] for name, declared in COUNTERS.items()}
"""Key of each counter's total."""
