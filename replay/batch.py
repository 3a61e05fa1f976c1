"""A minibatch of n-step transitions, whole and with each frame once, which is how it travels."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.errors import MessageError
from common.protocol.message import Array, Message
from common.protocol.step_fields import FRAME_SHAPE
from common.protocol.wire import MAX_MESSAGE_BYTES


class Batch(NamedTuple):
    """B transitions from s_tm1, n steps long or as long as their episode lets them be."""

    ids: NDArray[np.int64]
    """Of the steps at s_tm1, never used twice, ``[B]``."""
    s_tm1: NDArray[np.uint8]
    """``[B, H, 84, 84]``, oldest frame first."""
    a_tm1: NDArray[np.uint8]
    r_t: NDArray[np.float32]
    """Discounted sum of the rewards on the way, ``[B]``."""
    discount_t: NDArray[np.float32]
    """γ to the power of the decisions on the way; 0 if the episode terminated there, ``[B]``."""
    s_t: NDArray[np.uint8]
    """State after those steps, ``[B, H, 84, 84]``; of no meaning where discount_t is 0."""
    weights: NDArray[np.float32]
    """Importance weights, the largest 1, ``[B]``."""
    x_tm1: NDArray[np.float32]
    """Vector observation beside s_tm1, ``[B, P]``."""
    x_t: NDArray[np.float32]


@dataclass(frozen=True)
class SharedBatch(Message):
    """The same B transitions, with each of F frames once: of the 8 of a one-step transition, 5
    differ."""

    ids: Annotated[NDArray[np.int64], Array("B")]
    frames: Annotated[NDArray[np.uint8], Array("F", *FRAME_SHAPE)]
    stacks: Annotated[NDArray[np.int32], Array(2, "B", "H")]
    """Where in ``frames`` are those of s_tm1 and of s_t."""
    a_tm1: Annotated[NDArray[np.uint8], Array("B")]
    r_t: Annotated[NDArray[np.float32], Array("B")]
    discount_t: Annotated[NDArray[np.float32], Array("B")]
    weights: Annotated[NDArray[np.float32], Array("B")]
    x_tm1: Annotated[NDArray[np.float32], Array("B", "P")]
    x_t: Annotated[NDArray[np.float32], Array("B", "P")]

    def check(self) -> None:
        """See `Message.check`: frames that are there, and states no larger than a message."""
        stacks = self.stacks
        if stacks.size and not 0 <= stacks.min() <= stacks.max() < len(self.frames):
            raise MessageError(f"stacks should be of {len(self.frames)} frames")
        if stacks.size * FRAME_SHAPE[0] * FRAME_SHAPE[1] > MAX_MESSAGE_BYTES:
            raise MessageError(f"stacks of {stacks.size} frames are over the bound")

    def whole(self) -> Batch:
        """With states of their own, which may be written to."""
        s_tm1, s_t = self.frames.take(self.stacks, axis=0, mode="clip")
        return Batch(
            ids=self.ids,
            s_tm1=s_tm1,
            a_tm1=self.a_tm1,
            r_t=self.r_t,
            discount_t=self.discount_t,
            s_t=s_t,
            weights=self.weights,
            x_tm1=self.x_tm1,
            x_t=self.x_t,
        )
