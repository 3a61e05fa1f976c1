"""What the replay answers to an insert: it is stored, and what the actor should do next."""

from dataclasses import dataclass
from typing import Literal

from common.checked import Count, Fraction
from common.protocol.message import Message


@dataclass(frozen=True)
class Ack(Message):
    """The fate of a chunk, and what steers its actor."""

    status: Literal["stored", "duplicate", "poll", "refused"]
    """'poll' answers an empty insert, by which a throttled actor asks whether to go on; 'refused' a
    chunk of another run than ``run_id``."""
    throttle: bool
    """Pause: the learner is behind."""
    finished: bool
    """The run is over, leave."""
    agent_steps: Count
    """Agent steps of the run, over all actors; ε follows from it."""
    difficulty: Fraction
    """Share of their widths that the ranges of `randomise` have in the next game."""
    weights_version: Count
    """Newest weights there are."""
    run_id: str = ""
    """Identity of the replay's run."""
