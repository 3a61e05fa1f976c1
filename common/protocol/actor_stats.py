"""What an actor tells about itself, once a second and when it leaves."""

import dataclasses
from dataclasses import dataclass
from typing import Any, Literal, cast

from common.errors import MessageError
from common.press_latency import COUNTS
from common.protocol.wire import pack, take, unpack

Role = Literal["actor", "evaluator"]


@dataclass(frozen=True)
class ActorStats:
    """Counters of one actor process since its start."""

    name: str
    role: Role
    incarnation: int
    leaving: bool
    """Last message of this process."""
    steps: int
    steps_per_second: float
    epsilon: float
    weights_version: int
    made: int
    """Chunks cut from the stream; in the end made = acked + refused."""
    acked: int
    retried: int
    refused: int
    held_share: float
    """Share of the last second it paused because the learner was behind."""
    valid_share: float
    """Share of the steps since its start whose frame showed the screen."""
    match_share: float
    """Share of the steps since its start that ended with the commanded keys pressed."""
    decisions: int = 0
    """Of game time that its steps took."""
    missed_deadlines: int = 0
    """In real time: decisions for which no command of their own came in time."""
    late_frames: int = 0
    """In real time: emulator frames that began more than a frame too late."""
    waits_given_up: int = 0
    """Steps whose wait for the commanded keys ended at its bound."""
    key_times: tuple[int, ...] = ()
    """How long the hands took, as counts (see `common.press_latency`); none where nobody has
    told."""


def encode_stats(stats: ActorStats) -> bytes:
    return pack(dataclasses.asdict(stats))


def decode_stats(payload: bytes) -> ActorStats:
    """The counters inside ``payload``.

    Raises:
        MessageError: they are not all there, or not of their types.
    """
    message = unpack(payload)
    role = take(message, "role", str)
    if role not in ("actor", "evaluator"):
        raise MessageError(f"role is {role!r}")
    return ActorStats(
        name=take(message, "name", str),
        role=cast(Role, role),
        leaving=take(message, "leaving", bool),
        key_times=_take_key_times(message),
        **{
            name: take(message, name, int, 0)
            for name in (
                "incarnation",
                "steps",
                "weights_version",
                "made",
                "acked",
                "retried",
                "refused",
                "decisions",
                "missed_deadlines",
                "late_frames",
                "waits_given_up",
            )
        },
        **{
            name: take(message, name, float, 0.0)
            for name in (
                "steps_per_second",
                "epsilon",
                "held_share",
                "valid_share",
                "match_share",
            )
        },
    )


def _take_key_times(message: dict[str, Any]) -> tuple[int, ...]:
    found = message.get("key_times", [])
    if (
        not isinstance(found, list)
        or len(found) not in (0, COUNTS)
        or not all(type(count) is int and 0 <= count < 2**63 for count in found)
    ):
        raise MessageError(f"key_times should be {COUNTS} counts, or none")
    return tuple(found)
