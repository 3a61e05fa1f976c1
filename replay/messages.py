"""Messages between `RemoteReplay` and `ReplayServer`, except batches and progress."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from common.checked import MAX_COUNT, Amount, Count
from common.errors import MessageError
from common.protocol.message import Array, Message
from common.protocol.step_fields import FRAME_BYTES, FRAME_SHAPE
from common.protocol.wire import MAX_MESSAGE_BYTES

NO_BATCH = b""
"""The answer to a draw for which the limiter releases no batch."""
MAX_HELD_OUT = MAX_MESSAGE_BYTES // FRAME_BYTES
"""Number of states of one frame that fit into a message."""
MAX_PRIORITIES = 2**16
"""Maximum number of new priorities in a request, which keep other requests waiting for 0.1 s."""


@dataclass(frozen=True)
class SampleRequest(Message):
    """See `replay.interface.Replay.sample`. It brings new priorities along, so that they need no
    messages of their own."""

    LIMITS: ClassVar = {"B": (0, MAX_PRIORITIES)}

    drawn: Count | None
    """None asks for no minibatch: the request only brings priorities."""
    timeout: Amount
    ids: Annotated[NDArray[np.int64], Array("B")]
    """Ids of steps with a new priority."""
    priorities: Annotated[NDArray[np.float32], Array("B")]
    """Their priorities; see `replay.interface.Replay.update_priorities`."""

    def check(self) -> None:
        """See `Message.check`. A priority may be non-finite, but neither it nor an id is
        negative."""
        if (self.ids < 0).any() or (self.priorities < 0).any():
            raise MessageError("priorities and ids should not be negative")


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
