"""msgpack on the wire, with bounds on what a receiver unpacks.

Nothing is unpickled, here or anywhere else. A message that breaks a bound raises `MessageError`,
which its receiver counts and answers.
"""

import dataclasses
import reprlib
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from common.checked import MAX_COUNT
from common.errors import MessageError

SCHEMA = 9
"""Version of every message; processes of different versions refuse each other.

`tests/common/protocol/test_schema.py` fails if a message changes, and says what to do here.
"""
MAX_MESSAGE_BYTES = 64 * 1024 * 1024
MAX_ITEMS = 10_000
"""Maximum number of items of one list or map."""
_MAX_VALUES = 200_000
"""Maximum number of lists, maps and their items in a whole message."""


def pack(message: dict[str, Any]) -> bytes:
    """Returns ``message`` with the schema's version as msgpack, arrays and dataclasses as maps.
    Raises MessageError if it is larger than a receiver accepts."""
    payload: bytes = msgpack.packb({"schema": SCHEMA, **message}, default=_plain)
    if len(payload) > MAX_MESSAGE_BYTES:
        raise MessageError(f"{len(payload)} bytes are over the bound of {MAX_MESSAGE_BYTES}")
    return payload


def unpack(payload: bytes) -> dict[str, Any]:
    """Returns the map in ``payload``, with arrays still as raw bytes.

    The number of values is bounded, because a list or map of one byte takes 60 bytes or more as an
    object. Raises MessageError if the payload is not msgpack, is too large, has too many values, is
    not a map, or has another schema.
    """
    if len(payload) > MAX_MESSAGE_BYTES:
        raise MessageError(f"{len(payload)} bytes are over the bound of {MAX_MESSAGE_BYTES}")
    left = _MAX_VALUES

    def count(container: Any) -> Any:
        nonlocal left
        left -= 1 + len(container)
        if left < 0:
            raise ValueError(f"more than {_MAX_VALUES} values")
        return container

    try:
        message = msgpack.unpackb(
            payload,
            object_hook=count,
            list_hook=count,
            max_array_len=MAX_ITEMS,
            max_map_len=MAX_ITEMS,
            max_ext_len=0,
        )
    except (ValueError, msgpack.UnpackException) as error:
        raise MessageError(f"not msgpack: {error}") from None
    if not isinstance(message, dict) or not all(isinstance(key, str) for key in message):
        raise MessageError("not a map with text keys")
    if type(message.get("schema")) is not int or message["schema"] != SCHEMA:
        told = reprlib.repr(message.get("schema"))
        raise MessageError(f"schema {told} where {SCHEMA} is spoken")
    return message


def _plain(value: Any) -> dict[str, Any]:
    """Returns a map that stands for a dataclass or an array."""
    if dataclasses.is_dataclass(value):
        return vars(value)
    if isinstance(value, np.ndarray):
        return pack_array(value)
    raise TypeError(f"a message cannot hold a {type(value).__name__}")


def pack_array(array: NDArray[Any]) -> dict[str, Any]:
    """Returns a map of dtype, shape and raw little-endian bytes, which are not copied."""
    plain = np.ascontiguousarray(array)
    # The view saves a copy; msgpack does not accept that of an empty array.
    data = plain.data.cast("B") if plain.size else b""
    return {"dtype": plain.dtype.str, "shape": list(array.shape), "data": data}


def encode_version(version: int, run_id: str, signature: bytes = b"") -> bytes:
    """Returns the attachment of weights: version, run and signature."""
    return f"{version} {run_id}\n".encode() + signature


def decode_version(attachment: bytes, run_id: str) -> tuple[int, bytes]:
    """Returns version and unchecked signature from the attachment of weights. Raises MessageError
    if the version is not a number from 0 to `MAX_COUNT`, or the run is not ``run_id``."""
    about, _, signature = attachment.partition(b"\n")
    version, _, sender = about.partition(b" ")
    if not version.isdigit() or len(version) > 19 or int(version) > MAX_COUNT:
        raise MessageError(f"{attachment[:40]!r} is not a version of weights")
    if sender != run_id.encode():
        raise MessageError(f"weights of another run than {run_id}")
    return int(version), signature
