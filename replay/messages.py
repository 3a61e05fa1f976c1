"""The small messages between `RemoteReplay` and `ReplayServer`; batches and facts have their own.

Every decoder raises `MessageError` for anything that its encoder would not write.
"""

import numpy as np
from numpy.typing import NDArray

from common.protocol.chunk import FRAME_SHAPE
from common.protocol.wire import pack, pack_array, take, take_array, unpack
from replay.batch import SharedBatch, decode_batch, encode_batch

NO_BATCH = b""
"""The answer to a draw when the limiter does not let go of one."""

Held = tuple[NDArray[np.uint8], NDArray[np.float32]]
Priorities = tuple[NDArray[np.int64], NDArray[np.float32]]


def encode_sample_request(drawn: int, timeout: float) -> bytes:
    return pack({"drawn": drawn, "timeout": timeout})


def decode_sample_request(payload: bytes) -> tuple[int, float]:
    message = unpack(payload)
    return take(message, "drawn", int, 0), take(message, "timeout", float, 0.0)


def encode_sample_reply(batch: SharedBatch | None) -> bytes:
    return NO_BATCH if batch is None else encode_batch(batch)


def decode_sample_reply(payload: bytes) -> SharedBatch | None:
    return None if payload == NO_BATCH else decode_batch(payload)


def encode_priorities(ids: NDArray[np.int64], priorities: NDArray[np.float32]) -> bytes:
    return pack({"ids": pack_array(ids), "priorities": pack_array(priorities)})


def decode_priorities(payload: bytes) -> Priorities:
    message = unpack(payload)
    ids = take_array(message, "ids", np.int64, (None,))
    return ids, take_array(message, "priorities", np.float32, ids.shape)


def encode_held_out_request(count: int) -> bytes:
    return pack({"count": count})


def decode_held_out_request(payload: bytes) -> int:
    return int(take(unpack(payload), "count", int, 0))


def encode_held_out_reply(held: Held) -> bytes:
    return pack({"frames": pack_array(held[0]), "vectors": pack_array(held[1])})


def decode_held_out_reply(payload: bytes) -> Held:
    message = unpack(payload)
    frames = take_array(message, "frames", np.uint8, (None, None, *FRAME_SHAPE))
    return frames, take_array(message, "vectors", np.float32, (len(frames), None))


def encode_progress_request(since: int, finished: bool | None) -> bytes:
    return pack({"since": since, "finished": finished})


def decode_progress_request(payload: bytes) -> tuple[int, bool | None]:
    message = unpack(payload)
    silent = message.get("finished") is None
    return take(message, "since", int, 0), None if silent else take(message, "finished", bool)
