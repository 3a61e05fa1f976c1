"""A minibatch of n-step transitions, and its form on the wire."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.chunk import FRAME_SHAPE
from common.wire import pack, pack_array, take_array, unpack


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


def encode_batch(batch: Batch) -> bytes:
    return pack({name: pack_array(array) for name, array in batch._asdict().items()})


def decode_batch(payload: bytes) -> Batch:
    """The batch inside ``payload``, as read-only views of it.

    Raises:
        MessageError: it is none.
    """
    message = unpack(payload)
    ids = take_array(message, "ids", np.int64, (None,))
    count = len(ids)
    s_tm1 = take_array(message, "s_tm1", np.uint8, (count, None, *FRAME_SHAPE))
    x_tm1 = take_array(message, "x_tm1", np.float32, (count, None))
    return Batch(
        ids=ids,
        s_tm1=s_tm1,
        a_tm1=take_array(message, "a_tm1", np.uint8, (count,)),
        r_t=take_array(message, "r_t", np.float32, (count,)),
        discount_t=take_array(message, "discount_t", np.float32, (count,)),
        s_t=take_array(message, "s_t", np.uint8, s_tm1.shape),
        weights=take_array(message, "weights", np.float32, (count,)),
        x_tm1=x_tm1,
        x_t=take_array(message, "x_t", np.float32, x_tm1.shape),
    )
