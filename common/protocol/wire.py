"""msgpack on the wire, with bounds on what a receiver unpacks.

The values of a large array are compressed by LZ4 if that makes them smaller: frames of a game to a
twentieth or less, in less time than sending them would take. Nothing is unpickled, here or anywhere
else. A message that breaks a bound raises `MessageError`, which its receiver counts and answers.
"""

import dataclasses
import reprlib
from typing import Any

import msgpack
import numpy as np
from lz4 import block as lz4
from numpy.typing import NDArray

from common.checked import MAX_COUNT
from common.errors import MessageError

SCHEMA = 10
"""Version of every message; processes of different versions refuse each other.

`tests/common/protocol/test_schema.py` fails if a message changes, and says what to do here.
"""
MAX_MESSAGE_BYTES = 64 * 1024 * 1024
"""Maximum size of a message, with its compressed arrays at their whole size."""
MAX_ITEMS = 10_000
"""Maximum number of items of one list or map."""
_MAX_VALUES = 200_000
"""Maximum number of lists, maps and their items in a whole message."""
_LZ4 = 1
"""Code of msgpack's extension type for a block of LZ4."""
_COMPRESSED_FROM = 4_096
"""Minimum size in bytes of an array that is compressed."""


def pack(message: dict[str, Any]) -> bytes:
    """Returns ``message`` with the schema's version as msgpack, arrays and dataclasses as maps.
    Raises MessageError if it is larger than a receiver accepts."""
    saved = 0

    def plain(value: Any) -> dict[str, Any]:
        nonlocal saved
        if dataclasses.is_dataclass(value):
            return vars(value)
        if isinstance(value, np.ndarray):
            packed = pack_array(value)
            if isinstance(packed["data"], msgpack.ExtType):
                saved += value.nbytes - len(packed["data"].data)
            return packed
        raise TypeError(f"a message cannot hold a {type(value).__name__}")

    payload: bytes = msgpack.packb({"schema": SCHEMA, **message}, default=plain)
    _check_size(len(payload) + saved)
    return payload


def unpack(payload: bytes) -> dict[str, Any]:
    """Returns the map in ``payload``, with arrays still as raw bytes, or compressed.

    The number of values is bounded, because a list or map of one byte takes 60 bytes or more as an
    object. Raises MessageError if the payload is not msgpack, is too large, has too many values, is
    not a map, or has another schema.
    """
    _check_size(len(payload))
    left = _MAX_VALUES

    def count(container: Any) -> Any:
        nonlocal left
        left -= 1 + len(container)
        if left < 0:
            raise ValueError(f"more than {_MAX_VALUES} values")
        return container

    def block(code: int, data: bytes) -> msgpack.ExtType:
        if code != _LZ4:
            raise ValueError(f"an extension of type {code}")
        return msgpack.ExtType(code, data)

    try:
        message = msgpack.unpackb(
            payload,
            object_hook=count,
            list_hook=count,
            ext_hook=block,
            max_array_len=MAX_ITEMS,
            max_map_len=MAX_ITEMS,
        )
    except (ValueError, msgpack.UnpackException) as error:
        raise MessageError(f"not msgpack: {error}") from None
    if not isinstance(message, dict) or not all(isinstance(key, str) for key in message):
        raise MessageError("not a map with text keys")
    if type(message.get("schema")) is not int or message["schema"] != SCHEMA:
        told = reprlib.repr(message.get("schema"))
        raise MessageError(f"schema {told} where {SCHEMA} is spoken")
    return message


def _check_size(size: int) -> None:
    if size > MAX_MESSAGE_BYTES:
        raise MessageError(f"{size} bytes are over the bound of {MAX_MESSAGE_BYTES}")


def pack_array(array: NDArray[Any]) -> dict[str, Any]:
    """Returns a map of dtype, shape and raw little-endian bytes, which are not copied, or are
    compressed."""
    plain = np.ascontiguousarray(array)
    # The view saves a copy; msgpack does not accept that of an empty array.
    data = plain.data.cast("B") if plain.size else b""
    packed = {"dtype": plain.dtype.str, "shape": list(array.shape), "data": data}
    if plain.nbytes >= _COMPRESSED_FROM:
        compressed = lz4.compress(data, store_size=False)
        if len(compressed) < plain.nbytes:
            packed["data"] = msgpack.ExtType(_LZ4, compressed)
    return packed


def bytes_of(data: Any, size: int) -> bytes:
    """Returns the ``size`` bytes in ``data``, the field of `pack_array`. Raises MessageError if it
    holds anything else."""
    if isinstance(data, msgpack.ExtType):
        try:
            data = lz4.decompress(data.data, uncompressed_size=size)
        except (ValueError, lz4.LZ4BlockError) as error:
            raise MessageError(f"not a block of LZ4: {error}") from None
    if not isinstance(data, bytes) or len(data) != size:
        raise MessageError("not the bytes of its shape")
    return data


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
