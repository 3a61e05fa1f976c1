"""Arrays of messages: what goes in comes out, and what is not as declared is refused."""

import tracemalloc
from dataclasses import dataclass
from types import GenericAlias
from typing import Annotated, Any, ClassVar, TypeVar

import lz4.block
import msgpack
import numpy as np
import pytest
from numpy.typing import NDArray

from common.errors import MessageError
from common.protocol.message import Array, Message, Taking, dtype_of
from common.protocol.wire import SCHEMA, pack, pack_array, unpack


def taken(packed: Any, dtype: Any, *shape: int | str, **sizes: int) -> NDArray[Any]:
    taking = Taking({"N": (0, 9)}, sizes)
    return Array(*shape, most=1e9).take(packed, "field", np.dtype(dtype), taking)


@pytest.mark.parametrize("dtype", [np.uint8, np.bool_, np.int64, np.float32])
@pytest.mark.parametrize("shape", [(0,), (5,), (2, 0), (3, 4), (2, 3, 4)])
def test_arrays_keep_values_dtype_and_shape(dtype: Any, shape: tuple[int, ...]) -> None:
    array = np.arange(np.prod(shape)).reshape(shape).astype(dtype)
    found = taken(unpack(pack({"a": pack_array(array)}))["a"], dtype, *shape)
    assert found.dtype == dtype
    assert found.shape == shape
    assert (found == array).all()
    assert not found.flags.writeable


@pytest.mark.parametrize("dtype", [np.uint8, np.bool_, np.int64, np.float32])
def test_the_dtype_of_an_annotation_is_found_in_each_spelling_of_numpys(dtype: Any) -> None:
    """NumPy 2.4 has np.ndarray[shape, np.dtype[scalar]], and 2.5 an alias of the scalar alone."""
    spelt = np.ndarray[tuple[int, ...], np.dtype[dtype]]
    alias = GenericAlias(TypeVar("NDArray"), (dtype,))  # type: ignore[arg-type]
    assert dtype_of(NDArray[dtype]) == dtype_of(spelt) == dtype_of(alias) == np.dtype(dtype)


@pytest.mark.parametrize(
    "array",
    [
        np.arange(24, dtype=np.int32).reshape(4, 6)[::2, ::-3],
        np.arange(24, dtype=np.int32).reshape(4, 6).T,
    ],
    ids=["slices", "transposed"],
)
def test_strided_arrays_travel_by_value(array: NDArray[np.int32]) -> None:
    packed = unpack(pack({"a": pack_array(array)}))["a"]
    assert (taken(packed, np.int32, *array.shape) == array).all()


GOOD: dict[str, Any] = {"dtype": "<f4", "shape": [2, 3], "data": bytes(24)}


@pytest.mark.parametrize(
    "packed",
    [
        None,
        [],
        bytes(24),
        {},
        {**GOOD, "dtype": ">f4"},
        {**GOOD, "dtype": "<f8"},
        {**GOOD, "dtype": "O"},
        {**GOOD, "dtype": ["<f4"]},
        {**GOOD, "shape": [3, 2]},
        {**GOOD, "shape": [2]},
        {**GOOD, "shape": [2, 3, 1]},
        {**GOOD, "shape": [2, -3]},
        {**GOOD, "shape": [2, 3.0]},
        {**GOOD, "shape": [2, True]},
        {**GOOD, "shape": [2**31, 3], "data": b""},
        {**GOOD, "shape": [2**62, 2**62], "data": b""},
        {**GOOD, "shape": "23"},
        {**GOOD, "shape": None},
        {**GOOD, "data": bytes(23)},
        {**GOOD, "data": bytes(25)},
        {**GOOD, "data": b""},
        {**GOOD, "data": "x" * 24},
        {**GOOD, "data": [0.0] * 6},
        {**GOOD, "data": None},
    ],
)
def test_an_array_that_is_not_what_it_should_be_is_refused(packed: Any) -> None:
    with pytest.raises(MessageError, match="field"):
        taken(packed, np.float32, "N", 3)


def test_a_letter_admits_any_size() -> None:
    assert taken(GOOD, np.float32, "N", "M").shape == (2, 3)
    empty = {"dtype": "<f4", "shape": [0, 3], "data": b""}
    assert taken(empty, np.float32, "N", 3).shape == (0, 3)
    for size in (0, 2_000):
        long = {"dtype": "<f4", "shape": [size, 3], "data": bytes(size * 12)}
        assert taken(long, np.float32, "M", 3).shape == (size, 3)


def test_a_letter_is_one_size_throughout() -> None:
    assert taken(GOOD, np.float32, "N", 3, N=2).shape == (2, 3)
    with pytest.raises(MessageError, match="field has 2 where N is 1"):
        taken(GOOD, np.float32, "N", 3, N=1)
    with pytest.raises(MessageError, match="field has 3 where N is 2"):
        taken(GOOD, np.float32, "N", "N")


def test_a_letter_has_limits() -> None:
    nine = pack_array(np.zeros((9, 1), np.float32))
    ten = pack_array(np.zeros((10, 1), np.float32))
    assert len(taken(unpack(pack({"a": nine}))["a"], np.float32, "N", 1)) == 9
    with pytest.raises(MessageError, match="N is 10 where 0 to 9 are allowed"):
        taken(unpack(pack({"a": ten}))["a"], np.float32, "N", 1)


@dataclass(frozen=True)
class Frames(Message):
    LIMITS: ClassVar = {"T": (0, 100)}

    one: Annotated[NDArray[np.uint8], Array("T", 2**20)]
    two: Annotated[NDArray[np.int64], Array("U", 2**17)]


def test_large_arrays_come_out_as_they_went_in() -> None:
    rng = np.random.default_rng(1)
    sent = Frames(
        rng.integers(2, size=(2, 2**20), dtype=np.uint8), rng.integers(2**62, size=(2, 2**17))
    )
    assert sent.nbytes == 4 * 2**20
    payload = sent.encode()
    assert len(payload) < 1.5 * sent.two.nbytes
    found = Frames.decode(payload)
    for name in ("one", "two"):
        np.testing.assert_array_equal(getattr(found, name), getattr(sent, name))
        assert not getattr(found, name).flags.writeable


@pytest.mark.parametrize(
    ("one", "two", "match"),
    [
        (40, 25, "two is over the bound of 67108864 bytes"),
        (65, 0, "one is over the bound of 67108864 bytes"),
        (101, 0, "T is 101 where 0 to 100 are allowed"),
        (2**31 - 1, 0, "T is 2147483647 where 0 to 100 are allowed"),
        (0, 2**31 - 1, "two is over the bound of 67108864 bytes"),
    ],
)
def test_a_small_message_cannot_take_much_memory(one: int, two: int, match: str) -> None:
    """A block of LZ4 may be 255 times as large when it is decompressed."""

    def packed(rows: int, dtype: str, width: int) -> dict[str, Any]:
        block = lz4.block.compress(bytes(min(rows, 70) * 2**20), store_size=False)
        return {"dtype": dtype, "shape": [rows, width], "data": msgpack.ExtType(1, block)}

    fields = {"one": packed(one, "|u1", 2**20), "two": packed(two, "<i8", 2**17)}
    payload = msgpack.packb({"schema": SCHEMA, **fields})
    assert len(payload) < 600_000
    tracemalloc.start()
    try:
        with pytest.raises(MessageError, match=match):
            Frames.decode(payload)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 2.2 * (min(one, 40) + 1) * 2**20  # of the first alone, which lz4 copies once


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1.001e9, -1.001e9, 3e38])
def test_floats_are_finite_and_bounded(value: float) -> None:
    packed = unpack(pack({"a": pack_array(np.array([0, value, 0], np.float32))}))["a"]
    with pytest.raises(MessageError, match=r"field should be finite, and from -1e\+09 to 1e\+09"):
        taken(packed, np.float32, 3)


def test_the_bound_itself_is_admitted() -> None:
    packed = unpack(pack({"a": pack_array(np.array([1e9, -1e9], np.float32))}))["a"]
    assert taken(packed, np.float32, 2).tolist() == [1e9, -1e9]


@pytest.mark.parametrize("depth", [100, 900, 2_000])
def test_a_deep_list_in_an_array_is_refused_in_brief(depth: int) -> None:
    deep: list[Any] = []
    for _ in range(depth):
        deep = [deep]
    good = {"dtype": "<i8", "shape": [0], "data": b""}
    for wrong in ({"dtype": deep}, {"shape": deep}, {"shape": [deep]}, {"shape": [deep, deep]}):
        with pytest.raises(MessageError) as refused:
            Array("B").take({**good, **wrong}, "ids", np.dtype(np.int64), Taking({}))
        assert len(str(refused.value)) < 200
