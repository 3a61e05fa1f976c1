"""msgpack on the wire, with its bounds: what a receiver may be asked to unpack.

Nothing here or anywhere else unpickles. A message that breaks a bound raises `MessageError`,
which its receiver counts and answers.
"""

from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from common.errors import MessageError

SCHEMA = 4
"""Version of every message; processes of different versions refuse each other."""
MAX_MESSAGE_BYTES = 64 * 1024 * 1024
MAX_ITEMS = 10_000
"""Items of one list or one map."""
_MAX_VALUES = 200_000
"""Lists, maps and their items, in a whole message."""


def pack(message: dict[str, Any]) -> bytes:
    """Returns ``message`` with the schema's version, as msgpack.

    Raises:
        MessageError: it is larger than a receiver accepts.
    """
    payload: bytes = msgpack.packb({"schema": SCHEMA, **message})
    if len(payload) > MAX_MESSAGE_BYTES:
        raise MessageError(f"{len(payload)} bytes are over the bound of {MAX_MESSAGE_BYTES}")
    return payload


def unpack(payload: bytes) -> dict[str, Any]:
    """Returns the map inside ``payload``, its arrays still raw bytes.

    What it allocates is bounded: a list or map of one byte would take 60 and more as an object.

    Raises:
        MessageError: not msgpack, too large, of too many values, not a map, or of another schema.
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
    except (ValueError, msgpack.UnpackException, RecursionError) as error:
        raise MessageError(f"not msgpack: {error}") from None
    if not isinstance(message, dict) or not all(isinstance(key, str) for key in message):
        raise MessageError("not a map with text keys")
    if type(message.get("schema")) is not int or message["schema"] != SCHEMA:
        raise MessageError(f"schema {message.get('schema')!r} where {SCHEMA} is spoken")
    return message


def pack_array(array: NDArray[Any]) -> dict[str, Any]:
    """Returns a map of dtype, shape and raw little-endian bytes, which are not copied yet."""
    plain = np.ascontiguousarray(array)
    # The view saves a copy; an empty array has none that msgpack would take.
    data = plain.data.cast("B") if plain.size else b""
    return {"dtype": plain.dtype.str, "shape": list(array.shape), "data": data}


def take_array(packed: Any, name: str, dtype: Any, shape: tuple[int | None, ...]) -> NDArray[Any]:
    """Returns the array that ``packed`` holds (read-only, no copy); None in ``shape`` admits any
    length.

    Raises:
        MessageError: another dtype or shape, or bytes that do not fill it; the text has ``name``.
    """
    if not isinstance(packed, dict):
        raise MessageError(f"{name} should be an array")
    expected = np.dtype(dtype)
    if packed.get("dtype") != expected.str:
        raise MessageError(f"{name} should be {expected.str}, is {packed.get('dtype')!r:.40}")
    found = packed.get("shape")
    if (
        not isinstance(found, list)
        or len(found) != len(shape)
        or not all(type(size) is int and 0 <= size < 2**31 for size in found)
        or any(want is not None and want != size for want, size in zip(shape, found, strict=True))
    ):
        raise MessageError(f"{name} has shape {found!r:.40} where {shape} is expected")
    data = packed.get("data")
    count = 1
    for size in found:
        count *= size
    if not isinstance(data, bytes) or len(data) != count * expected.itemsize:
        raise MessageError(f"{name} does not hold the bytes of its shape")
    return np.frombuffer(data, expected).reshape(found)
