"""A minibatch of n-step transitions, whole and with each frame once, which is how it travels."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.errors import MessageError
from common.protocol.chunk import FRAME_SHAPE
from common.protocol.wire import MAX_MESSAGE_BYTES, pack, pack_array, take_array, unpack


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


class SharedBatch(NamedTuple):
    """The same, with each frame once: of the 8 of a one-step transition, 5 differ."""

    frames: NDArray[np.uint8]
    """``[F, 84, 84]``"""
    stacks: NDArray[np.int32]
    """Where in ``frames`` are those of s_tm1 and of s_t, ``[2, B, H]``."""
    ids: NDArray[np.int64]
    a_tm1: NDArray[np.uint8]
    r_t: NDArray[np.float32]
    discount_t: NDArray[np.float32]
    weights: NDArray[np.float32]
    x_tm1: NDArray[np.float32]
    x_t: NDArray[np.float32]

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


def encode_batch(batch: SharedBatch) -> bytes:
    return pack({name: pack_array(array) for name, array in batch._asdict().items()})


def decode_batch(payload: bytes) -> SharedBatch:
    """The batch inside ``payload``, as read-only views of it.

    Raises:
        MessageError: it is none, or its states would be larger than a message may be.
    """
    message = unpack(payload)
    ids = take_array(message, "ids", np.int64, (None,))
    count = len(ids)
    frames = take_array(message, "frames", np.uint8, (None, *FRAME_SHAPE))
    stacks = take_array(message, "stacks", np.int32, (2, count, None))
    if stacks.size and not 0 <= stacks.min() <= stacks.max() < len(frames):
        raise MessageError(f"stacks should be of {len(frames)} frames")
    if stacks.size * FRAME_SHAPE[0] * FRAME_SHAPE[1] > MAX_MESSAGE_BYTES:
        raise MessageError(f"stacks of {stacks.size} frames are over the bound")
    x_tm1 = take_array(message, "x_tm1", np.float32, (count, None))
    return SharedBatch(
        frames=frames,
        stacks=stacks,
        ids=ids,
        a_tm1=take_array(message, "a_tm1", np.uint8, (count,)),
        r_t=take_array(message, "r_t", np.float32, (count,)),
        discount_t=take_array(message, "discount_t", np.float32, (count,)),
        weights=take_array(message, "weights", np.float32, (count,)),
        x_tm1=x_tm1,
        x_t=take_array(message, "x_t", np.float32, x_tm1.shape),
    )
