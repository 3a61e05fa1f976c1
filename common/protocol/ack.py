"""What the replay answers to an insert: it is stored, and what the actor should do next."""

from typing import Literal, NamedTuple

from common.errors import MessageError
from common.protocol.wire import pack, take, unpack


class Ack(NamedTuple):
    """The chunk needs no care any more; the rest steers the actor."""

    status: Literal["stored", "duplicate", "poll"]
    """'poll' answers an empty insert, by which a throttled actor asks whether to go on."""
    throttle: bool
    """Pause: the learner is behind."""
    finished: bool
    """The run is over, leave."""
    agent_steps: int
    """Of the run, over all actors; ε follows from it."""
    weights_version: int
    """Newest weights there are."""


def encode_ack(ack: Ack) -> bytes:
    return pack(ack._asdict())


def decode_ack(payload: bytes) -> Ack:
    """Returns the acknowledgement inside ``payload``.

    Raises:
        MessageError: the payload is not a valid Ack.
    """
    message = unpack(payload)
    status = take(message, "status", str)
    if status not in ("stored", "duplicate", "poll"):
        raise MessageError(f"status is {status!r}")
    return Ack(
        status,
        take(message, "throttle", bool),
        take(message, "finished", bool),
        take(message, "agent_steps", int, 0),
        take(message, "weights_version", int, 0),
    )
