"""msgpack on the wire, with its bounds: what a receiver may be asked to unpack.

Nothing here or anywhere else unpickles. A message that breaks a bound raises `MessageError`,
which its receiver counts and answers.
"""

from collections.abc import Iterator
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from common.errors import MessageError

SCHEMA = 3
"""Version of every message; processes of different versions refuse each other."""
MAX_MESSAGE_BYTES = 64 * 1024 * 1024

_HEAD_BYTES = 4_096
_SMALL = 2**16 - 1
"""Bytes of data that are left to msgpack."""
_BIN_32 = b"\xc6"
"""What msgpack writes before a length in 4 bytes, which it does above `_SMALL`."""


def pack(message: dict[str, Any]) -> bytes:
    """``message`` with the schema's version, as msgpack.

    Raises:
        MessageError: it is larger than a receiver accepts.
    """
    payload = b"".join(_pieces({"schema": SCHEMA, **message}))
    if len(payload) > MAX_MESSAGE_BYTES:
        raise MessageError(f"{len(payload)} bytes are over the bound of {MAX_MESSAGE_BYTES}")
    return payload


def _pieces(message: dict[str, Any]) -> Iterator[bytes | memoryview]:
    """What msgpack would write, but with the data of big arrays as they lie in memory.

    So a message is copied once, into memory of its final size; msgpack itself would grow a buffer
    and copy that again, into fresh memory each time, whose page faults take longer than the copies.
    """
    packer = msgpack.Packer(buf_size=_HEAD_BYTES, autoreset=False)
    packer.pack_map_header(len(message))
    for name, value in message.items():
        packer.pack(name)
        data = value["data"] if isinstance(value, dict) else b""
        if len(data) <= _SMALL:
            packer.pack(value)
            continue
        packer.pack_map_header(len(value))
        for part, content in value.items():
            packer.pack(part)
            if part != "data":
                packer.pack(content)
        # "data" comes last in an array: its header ends the piece, its bytes are the next.
        yield packer.bytes() + _BIN_32 + len(data).to_bytes(4, "big")
        yield data
        packer.reset()
    yield packer.bytes()


def unpack(payload: bytes) -> dict[str, Any]:
    """The map inside ``payload``, its arrays still raw bytes.

    Raises:
        MessageError: not msgpack, too large, not a map, or of another schema.
    """
    if len(payload) > MAX_MESSAGE_BYTES:
        raise MessageError(f"{len(payload)} bytes are over the bound of {MAX_MESSAGE_BYTES}")
    try:
        message = msgpack.unpackb(payload)  # lengths are bounded by the payload
    except (ValueError, msgpack.UnpackException, RecursionError) as error:
        raise MessageError(f"not msgpack: {error}") from None
    if not isinstance(message, dict) or not all(isinstance(key, str) for key in message):
        raise MessageError("not a map with text keys")
    if type(message.get("schema")) is not int or message["schema"] != SCHEMA:
        raise MessageError(f"schema {message.get('schema')!r} where {SCHEMA} is spoken")
    return message


def take(message: dict[str, Any], name: str, kind: type, least: float = -np.inf) -> Any:
    """Field ``name``, checked to be exactly a ``kind`` and not below ``least``."""
    found = message.get(name)
    if type(found) is not kind:
        raise MessageError(f"{name} should be of type {kind.__name__}")
    value: Any = found
    if kind in (int, float) and not least <= value < float("inf"):
        raise MessageError(f"{name} is {value!r}")
    if kind is int and value.bit_length() > 63:
        raise MessageError(f"{name} does not fit 63 bits")
    if kind is str and len(value) > 200:
        raise MessageError(f"{name} is longer than 200 characters")
    return value


def pack_array(array: NDArray[Any]) -> dict[str, Any]:
    """An array as a map of dtype, shape and raw little-endian bytes, which are not copied yet."""
    plain = np.ascontiguousarray(array)
    # The view saves a copy; an empty array has none that msgpack would take.
    data = plain.data.cast("B") if plain.size else b""
    return {"dtype": plain.dtype.str, "shape": list(array.shape), "data": data}


def take_array(
    message: dict[str, Any], name: str, dtype: Any, shape: tuple[int | None, ...]
) -> NDArray[Any]:
    """Array field ``name`` (read-only, no copy); None in ``shape`` admits any length.

    Raises:
        MessageError: another dtype or shape, or bytes that do not fill it.
    """
    packed = message.get(name)
    if not isinstance(packed, dict):
        raise MessageError(f"{name} should be an array")
    expected = np.dtype(dtype)
    if packed.get("dtype") != expected.str:
        raise MessageError(f"{name} should be {expected.str}, is {packed.get('dtype')!r}")
    found = packed.get("shape")
    if (
        not isinstance(found, list)
        or len(found) != len(shape)
        or not all(type(size) is int and 0 <= size < 2**31 for size in found)
        or any(want is not None and want != size for want, size in zip(shape, found, strict=True))
    ):
        raise MessageError(f"{name} has shape {found!r} where {shape} is expected")
    data = packed.get("data")
    count = 1
    for size in found:
        count *= size
    if not isinstance(data, bytes) or len(data) != count * expected.itemsize:
        raise MessageError(f"{name} does not hold the bytes of its shape")
    return np.frombuffer(data, expected).reshape(found)
