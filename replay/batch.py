"""A minibatch of n-step transitions, in two forms: whole, and with each frame once to travel."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainValidator, ValidationInfo

from common.errors import MessageError
from common.protocol.message import Array, Message
from common.protocol.step_fields import FRAME_BYTES, FRAME_SHAPE, drawn_fields
from common.protocol.wire import MAX_MESSAGE_BYTES


class Batch(NamedTuple):
    """B transitions from s_tm1 over n steps, or fewer if the episode ends before."""

    ids: NDArray[np.int64]
    """Ids of the steps at s_tm1, ``[B]``; an id is never used twice."""
    s_tm1: NDArray[np.uint8]
    """First states, ``[B, H, 84, 84]``, oldest frame first."""
    a_tm1: NDArray[np.uint8]
    """Actions in s_tm1, ``[B]``."""
    r_t: NDArray[np.float32]
    """Discounted sum of the rewards on the way, ``[B]``."""
    discount_t: NDArray[np.float32]
    """γ to the power of the agent steps on the way; 0 if the episode terminated there, ``[B]``."""
    s_t: NDArray[np.uint8]
    """States after those steps, ``[B, H, 84, 84]``; meaningless where discount_t is 0."""
    weights: NDArray[np.float32]
    """Importance weights, the largest 1, ``[B]``."""
    x_tm1: NDArray[np.float32]
    """Vector observations beside s_tm1, ``[B, P]``."""
    x_t: NDArray[np.float32]
    """Vector observations beside s_t, ``[B, P]``."""
    drawn: Mapping[str, NDArray[Any]] = MappingProxyType({})
    """The steps' values of each field of `STEP_FIELDS` that is declared ``drawn``, ``[B, ...]``."""


def _take_drawn(packed: Any, info: ValidationInfo[Any]) -> dict[str, NDArray[Any]]:
    """Returns the arrays of `SharedBatch.drawn`; see `Array.take`."""
    fields, taking = drawn_fields(), info.context
    if not isinstance(packed, dict) or packed.keys() != fields.keys():
        raise MessageError(f"drawn should be the fields {', '.join(fields) or 'none'}")
    # Without B, the other fields are missing too, and refused.
    taking.sizes["T"] = taking.sizes.get("B", 0)
    return {
        name: field.array.take(packed[name], name, field.dtype, taking)
        for name, field in fields.items()
    }


@dataclass(frozen=True)
class SharedBatch(Message):
    """The same B transitions, with each of their F frames once. Of the 8 frames of a one-step
    transition, 5 differ."""

    ids: Annotated[NDArray[np.int64], Array("B")]
    frames: Annotated[NDArray[np.uint8], Array("F", *FRAME_SHAPE)]
    stacks: Annotated[NDArray[np.int32], Array(2, "B", "H")]
    """Indices in ``frames`` of the frames of s_tm1 and of s_t."""
    a_tm1: Annotated[NDArray[np.uint8], Array("B")]
    r_t: Annotated[NDArray[np.float32], Array("B")]
    discount_t: Annotated[NDArray[np.float32], Array("B")]
    weights: Annotated[NDArray[np.float32], Array("B")]
    x_tm1: Annotated[NDArray[np.float32], Array("B", "P")]
    x_t: Annotated[NDArray[np.float32], Array("B", "P")]
    drawn: Annotated[dict[str, NDArray[Any]], PlainValidator(_take_drawn)] = field(
        default_factory=dict
    )

    def check(self) -> None:
        """See `Message.check`: the frames must exist, and the states must not exceed a message."""
        stacks = self.stacks
        if stacks.size and not 0 <= stacks.min() <= stacks.max() < len(self.frames):
            raise MessageError(f"stacks should be of {len(self.frames)} frames")
        if stacks.size * FRAME_BYTES > MAX_MESSAGE_BYTES:
            raise MessageError(f"stacks of {stacks.size} frames are over the bound")

    def whole(self) -> Batch:
        """Returns the batch with whole states, which are writable copies."""
        s_tm1, s_t = self.frames.take(self.stacks, axis=0, mode="clip")
        rest = {name: getattr(self, name) for name in Batch._fields if name not in ("s_tm1", "s_t")}
        return Batch(s_tm1=s_tm1, s_t=s_t, **rest)
