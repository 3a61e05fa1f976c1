"""`Ack`: the replay's answer to an insert."""

from dataclasses import dataclass
from typing import Literal

from common.checked import Count, Fraction
from common.protocol.message import Message


@dataclass(frozen=True)
class Ack(Message):
    """What became of a chunk, and what its actor should do next."""

    status: Literal["stored", "duplicate", "poll", "refused"]
    """'poll' answers an empty insert, by which a throttled actor asks whether to go on. 'refused'
    answers a chunk of another run than ``run_id``."""
    throttle: bool
    """Whether the actor should pause because the learner is behind."""
    finished: bool
    """Whether the run is over, so that the actor should leave."""
    agent_steps: Count
    """Agent steps of the run, over all actors; they determine ε."""
    difficulty: Fraction
    """Share of their full widths that the ranges of `randomise` have in the next game."""
    weights_version: Count
    """Version of the newest weights."""
    run_id: str = ""
    """Identity of the replay's run."""
