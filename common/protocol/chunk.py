"""`Chunk`: T consecutive steps of one environment's stream, the unit that actors send.

A chunk can be used by itself. Its ``context`` holds the older frames of its first states; later
chunks of the same stream complete its last n-step returns. Each frame travels once, except for the
context (at most ``frame_stack - 1`` frames), which the replay stores only if the previous chunk is
missing.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge, Lt
from numpy.typing import NDArray

from common.checked import MAX_SIZE, Count, Fraction, Name, Rows, Score
from common.errors import MessageError
from common.proprioception import MAX_VECTOR
from common.protocol.message import Array, Message
from common.protocol.step_fields import FRAME_BYTES, FRAME_SHAPE, StepFields
from common.settings.conditions import MAX_FRAME_STACK
from common.settings.config import MAX_CHUNK_STEPS

MAX_CONTEXT = MAX_FRAME_STACK - 1
MAX_CHUNK_BYTES = MAX_CONTEXT * FRAME_BYTES + 2 * MAX_CHUNK_STEPS * (FRAME_BYTES + 4 * MAX_VECTOR)
"""Maximum size of a chunk's frames and vectors, each step of which may be truncated."""


class Game(NamedTuple):
    """One whole game, from reset to game over, whatever episodes the learner saw in it."""

    score: Score
    steps: Annotated[int, Ge(0), Lt(2**31)]


@dataclass(frozen=True)
class Chunk(StepFields, Message):
    """Steps ``t = 0 … T-1``, which continue the previous chunk's episode unless ``context`` is
    empty."""

    LIMITS: ClassVar = {
        "T": (1, MAX_CHUNK_STEPS),
        "P": (0, MAX_VECTOR),
        "C": (0, MAX_CONTEXT),
        "F": (0, MAX_CHUNK_STEPS),
    }

    run_id: str
    actor: Name
    incarnation: Count
    """Number that differs for each start of the actor's process, so that its sequence numbers may
    start again."""
    stream: Count
    """Index of the actor's environment."""
    sequence: Count
    """0, 1, 2 … within each stream of an incarnation."""
    weights_version: Count
    """Version of the oldest weights that chose one of its actions."""
    epsilon: Fraction
    context: Annotated[NDArray[np.uint8], Array("C", *FRAME_SHAPE)]
    """Frames of the same episode before step 0, oldest first, C < frame_stack."""
    final_frames: Annotated[NDArray[np.uint8], Array("F", *FRAME_SHAPE)]
    """The frame after each truncated step, in order."""
    final_vectors: Annotated[NDArray[np.float32], Array("F", "P", most=MAX_SIZE)]
    """The vector observation after each truncated step, in order."""
    games: Rows[Game] = ()
    """Games that ended within the chunk."""

    def __len__(self) -> int:
        return len(self.actions)

    def check(self) -> None:
        """See `Message.check`: refuses steps that no actor could have made."""
        if len(self.final_frames) != np.count_nonzero(self.truncated):
            raise MessageError("final_frames should be one for each truncated step")
        if (self.terminated & self.truncated).any():
            raise MessageError("a step cannot be both terminated and truncated")
        if not (self.elapsed >= 1).all():
            raise MessageError("a step takes at least one agent step: elapsed is 0")
        if len(self.games) > len(self):
            raise MessageError(f"{len(self.games)} games where {len(self)} at most could end")
