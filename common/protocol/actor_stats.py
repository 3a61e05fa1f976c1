"""What an actor tells about itself, once a second and when it leaves."""

from dataclasses import dataclass
from typing import Literal

from common.checked import Count, Positive, Values
from common.errors import MessageError
from common.press_latency import COUNTS
from common.protocol.message import Message

Role = Literal["actor", "evaluator"]


@dataclass(frozen=True)
class ActorStats(Message):
    """Counters of one actor process since its start."""

    name: str
    role: Role
    incarnation: Count
    leaving: bool
    """Last message of this process."""
    steps: Count
    steps_per_second: Positive
    epsilon: Positive
    weights_version: Count
    made: Count
    """Chunks cut from the stream; in the end made = acked + refused."""
    acked: Count
    retried: Count
    refused: Count
    held_share: Positive
    """Share of the last second it paused because the learner was behind."""
    valid_share: Positive
    """Share of the steps since its start whose frame showed the screen."""
    match_share: Positive
    """Share of the steps since its start that ended with the commanded keys pressed."""
    decisions: Count = 0
    """Of game time that its steps took."""
    missed_deadlines: Count = 0
    """In real time: decisions for which no command of their own came in time."""
    late_frames: Count = 0
    """In real time: emulator frames that began more than a frame too late."""
    waits_given_up: Count = 0
    """Steps whose wait for the commanded keys ended at its bound."""
    key_times: Values[Count] = ()
    """How long the hands took, as counts (see `common.press_latency`); none where nobody has
    told."""

    def check(self) -> None:
        """See `Message.check`."""
        if len(self.key_times) not in (0, COUNTS):
            raise MessageError(f"key_times should be {COUNTS} counts, or none")
