"""A minibatch of n-step transitions, whole and with each frame once, which is how it travels."""

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
    """B transitions from s_tm1, n steps long or as long as their episode lets them be."""

    ids: NDArray[np.int64]
    """Ids of the steps at s_tm1, never used twice, ``[B]``."""
    s_tm1: NDArray[np.uint8]
    """``[B, H, 84, 84]``, oldest frame first."""
    a_tm1: NDArray[np.uint8]
    """Actions there, ``[B]``."""
    r_t: NDArray[np.float32]
    """Discounted sum of the rewards on the way, ``[B]``."""
    discount_t: NDArray[np.float32]
    """γ to the power of the agent steps on the way; 0 if the episode terminated there, ``[B]``."""
    s_t: NDArray[np.uint8]
    """State after those steps, ``[B, H, 84, 84]``; of no meaning where discount_t is 0."""
    weights: NDArray[np.float32]
    """Importance weights, the largest 1, ``[B]``."""
    x_tm1: NDArray[np.float32]
    """Vector observation beside s_tm1, ``[B, P]``."""
    x_t: NDArray[np.float32]
    """The same beside s_t."""
    drawn: Mapping[str, NDArray[Any]] = MappingProxyType({})
    """The steps' values of each field of `STEP_FIELDS` that is declared as drawn, ``[B, ...]``."""


def _take_drawn(packed: Any, info: ValidationInfo[Any]) -> dict[str, NDArray[Any]]:
    """Returns the arrays of `SharedBatch.drawn`, see `Array.take`."""
    fields, (sizes, limits) = drawn_fields(), info.context
    if not isinstance(packed, dict) or packed.keys() != fields.keys():
        raise MessageError(f"drawn should be the fields {', '.join(fields) or 'none'}")
    sizes["T"] = sizes.get("B", 0)  # without B all else is missing too, and is refused
    return {
        name: field.array.take(packed[name], name, field.dtype, sizes, limits)
        for name, field in fields.items()
    }


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
    drawn: Annotated[dict[str, NDArray[Any]], PlainValidator(_take_drawn)] = field(
        default_factory=dict
    )

    def check(self) -> None:
        """See `Message.check`: frames that are there, and states no larger than a message."""
        stacks = self.stacks
        if stacks.size and not 0 <= stacks.min() <= stacks.max() < len(self.frames):
            raise MessageError(f"stacks should be of {len(self.frames)} frames")
        if stacks.size * FRAME_BYTES > MAX_MESSAGE_BYTES:
            raise MessageError(f"stacks of {stacks.size} frames are over the bound")

    def whole(self) -> Batch:
        """Returns the batch with states of their own, which may be written to."""
        s_tm1, s_t = self.frames.take(self.stacks, axis=0, mode="clip")
        rest = {name: getattr(self, name) for name in Batch._fields if name not in ("s_tm1", "s_t")}
        return Batch(s_tm1=s_tm1, s_t=s_t, **rest)
