"""`Message`: a dataclass that travels between processes.

Codec and checks need nothing but its declaration. Scalars are checked by `common.checked`, arrays
against the dtype and the `Array` in their annotation::

    @dataclass(frozen=True)
    class HeldOutStates(Message):
        frames: Annotated[NDArray[np.uint8], Array("N", "H", 84, 84)]
        vectors: Annotated[NDArray[np.float32], Array("N", "P")]
"""

import reprlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import GetCoreSchemaHandler, ValidationInfo
from pydantic_core import CoreSchema, core_schema

from common.checked import Invalid, build
from common.errors import MessageError
from common.protocol.wire import MAX_MESSAGE_BYTES, bytes_of, pack, unpack


@dataclass
class Taking:
    """What is known of a message while its arrays are taken, one after the other."""

    limits: Mapping[str, tuple[int, int]]
    """See `Message.LIMITS`."""
    sizes: dict[str, int] = field(default_factory=dict)
    """By letter, its size in the arrays so far."""
    room: int = MAX_MESSAGE_BYTES
    """Maximum size of the arrays that are left, in bytes."""


class Array:
    """The declared shape of an array: fixed sizes, and letters.

    A letter stands for the same size throughout its message. Booleans must be 0 or 1. With
    ``most``, all values must be finite and between -``most`` and ``most``.
    """

    def __init__(self, *shape: int | str, most: float | None = None) -> None:
        self.shape = shape
        self.most = most

    def shape_for(self, sizes: Mapping[str, int]) -> tuple[int, ...]:
        """Returns the shape with its letters replaced by their sizes."""
        return tuple(sizes[size] if isinstance(size, str) else size for size in self.shape)

    def __get_pydantic_core_schema__(self, source: Any, _: GetCoreSchemaHandler) -> CoreSchema:
        dtype = dtype_of(source)

        def take(packed: Any, info: ValidationInfo[Any]) -> NDArray[Any]:
            return self.take(packed, str(info.field_name), dtype, info.context)

        return core_schema.with_info_plain_validator_function(take)

    def take(
        self,
        packed: Any,
        name: str,
        dtype: np.dtype[Any],
        taking: Taking,
    ) -> NDArray[Any]:
        """Returns the array in ``packed``, read-only, and notes its sizes in ``taking``. It is
        copied only if it was compressed. Raises MessageError if the array is not as declared, or
        breaks a bound or limit."""
        sizes, limits = taking.sizes, taking.limits
        if not isinstance(packed, dict):
            raise MessageError(f"{name} should be an array")
        if packed.get("dtype") != dtype.str:
            told = reprlib.repr(packed.get("dtype"))
            raise MessageError(f"{name} should be {dtype.str}, is {told}")
        found, count = packed.get("shape"), 1
        if not isinstance(found, list) or len(found) != len(self.shape):
            told = reprlib.repr(found)
            raise MessageError(f"{name} has shape {told} where {self.shape} is expected")
        for letter, size in zip(self.shape, found, strict=True):
            wanted = sizes.get(letter, size) if isinstance(letter, str) else letter
            if type(size) is not int or not 0 <= size < 2**31 or size != wanted:
                told = reprlib.repr(size)
                raise MessageError(f"{name} has {told} where {letter} is {reprlib.repr(wanted)}")
            if isinstance(letter, str):
                sizes[letter] = size
                least, most = limits.get(letter, (0, size))
                if not least <= size <= most:
                    raise MessageError(f"{letter} is {size} where {least} to {most} are allowed")
            count *= size
        taking.room -= count * dtype.itemsize
        if taking.room < 0:
            raise MessageError(f"{name} is over the bound of {MAX_MESSAGE_BYTES} bytes")
        try:
            data = bytes_of(packed.get("data"), count * dtype.itemsize)
        except MessageError as error:
            raise MessageError(f"{name} holds {error}") from None
        array: NDArray[Any] = np.frombuffer(data, dtype).reshape(found)
        if dtype == np.bool_ and data.strip(b"\0\1"):
            raise MessageError(f"{name} should be booleans")
        if self.most is not None and not (np.abs(array) <= self.most).all():
            raise MessageError(f"{name} should be finite, and from -{self.most:g} to {self.most:g}")
        return array


def dtype_of(annotation: Any) -> np.dtype[Any]:
    """Returns the dtype of an annotation such as ``NDArray[np.uint8]``."""
    # The last is np.uint8 where NDArray is an alias (NumPy 2.5), else np.dtype[np.uint8].
    *_, last = get_args(annotation)
    dtype: np.dtype[Any] = np.dtype((get_args(last) or (last,))[0])
    return dtype


class Message:
    """Base of all messages, each of which is a frozen dataclass of its fields."""

    LIMITS: ClassVar[dict[str, tuple[int, int]]] = {}
    """Minimum and maximum of those letters in its arrays' shapes that are bounded."""

    @property
    def nbytes(self) -> int:
        """Size of the arrays among its fields, bytes."""
        return sum(each.nbytes for each in vars(self).values() if isinstance(each, np.ndarray))

    def encode(self) -> bytes:
        """Returns the message as msgpack. Raises MessageError if it is larger than a receiver
        accepts."""
        return pack(vars(self))

    @classmethod
    def decode(cls, payload: bytes) -> Self:
        """Returns the message in ``payload``; its arrays are read-only, and views of the payload
        unless they were compressed. Raises MessageError if the payload is not what `encode` writes,
        or breaks a bound."""
        fields = unpack(payload)
        del fields["schema"]
        try:
            message = build(cls, fields, context=Taking(cls.LIMITS))
        except Invalid as error:
            raise MessageError(str(error)) from None
        message.check()
        return message

    def check(self) -> None:
        """Checks the rules between fields. Raises MessageError if one is broken."""
