"""Messages between `RemoteReplay` and `ReplayServer`, except batches and progress."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from common.checked import MAX_COUNT, Amount, Count
from common.protocol.message import Array, Message
from common.protocol.step_fields import FRAME_BYTES, FRAME_SHAPE
from common.protocol.wire import MAX_MESSAGE_BYTES

NO_BATCH = b""
"""The answer to a draw for which the limiter releases no batch."""
MAX_HELD_OUT = MAX_MESSAGE_BYTES // FRAME_BYTES
"""Number of states of one frame that fit into a message."""


@dataclass(frozen=True)
class SampleRequest(Message):
    """See `replay.interface.Replay.sample`. It brings new priorities along, so that they need no
    messages of their own."""

    drawn: Count
    timeout: Amount
    ids: Annotated[NDArray[np.int64], Array("B")]
    """Ids of steps with a new priority."""
    priorities: Annotated[NDArray[np.float32], Array("B")]
    """Their priorities; see `replay.interface.Replay.update_priorities`."""


@dataclass(frozen=True)
class HeldOutRequest(Message):
    """Asks for states on which the mean max-Q is measured."""

    count: Annotated[int, Ge(0), Le(MAX_HELD_OUT)]
    newest: Count | None = None


@dataclass(frozen=True)
class HeldOutStates(Message):
    """The answer: N states of H frames, with vector observations of P components."""

    frames: Annotated[NDArray[np.uint8], Array("N", "H", *FRAME_SHAPE)]
    vectors: Annotated[NDArray[np.float32], Array("N", "P")]


@dataclass(frozen=True)
class ProgressRequest(Message):
    """See `replay.interface.Replay.progress`."""

    since: Count = MAX_COUNT
    goal: Count | None = None
    durable: bool = False
    """See `replay.interface.Replay.sync`."""
    drain: bool = False
    """See `replay.interface.Replay.drain`."""
