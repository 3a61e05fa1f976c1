"""Messages: what goes in comes out, and nothing that arrives can do more than be refused."""

import tracemalloc
from typing import Any

import lz4.block
import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import MessageError
from common.protocol import wire
from common.protocol.wire import SCHEMA, bytes_of, decode_version, encode_version, pack, unpack

SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats(allow_nan=False)
    | st.text(max_size=20)
    | st.binary(max_size=20)
)
MESSAGES = st.dictionaries(
    st.text(max_size=10).filter(lambda key: key != "schema"),
    SCALARS | st.lists(SCALARS, max_size=5),
    max_size=6,
)


@given(MESSAGES)
def test_a_message_comes_out_as_it_went_in(message: dict[str, Any]) -> None:
    assert unpack(pack(message)) == {"schema": SCHEMA, **message}


@given(st.binary(max_size=200))
def test_random_bytes_are_only_ever_refused(payload: bytes) -> None:
    with pytest.raises(MessageError):
        unpack(payload)


@given(MESSAGES, st.data())
def test_a_truncated_message_is_refused(message: dict[str, Any], data: st.DataObject) -> None:
    payload = pack(message)
    with pytest.raises(MessageError, match="not msgpack"):
        unpack(payload[: data.draw(st.integers(0, len(payload) - 1))])


@pytest.mark.parametrize(
    "payload",
    [
        b"\xdf\xff\xff\xff\xff",
        b"\xdd\xff\xff\xff\xff\x00",
        b"\xc6\xff\xff\xff\xff\x00",
        b"\xdb\xff\xff\xff\xff\x00",
        b"\xc9\xff\xff\xff\xff\x01",
        b"\x91" * 100_000,
        b"\x81\xa1a" * 100_000,
        b"\x81\xa1\xff\x00",
        b"\x81\xa1a\xd4\x05\x00",
        b"\x80\x80",
    ],
    ids=[
        "map of 4 G",
        "list of 4 G",
        "4 GB of bytes",
        "4 GB of text",
        "extension of 4 GB",
        "100,000 lists deep",
        "100,000 maps deep",
        "no UTF-8",
        "extension of 1 byte",
        "two messages",
    ],
)
def test_lying_lengths_and_depths_are_refused(payload: bytes) -> None:
    with pytest.raises(MessageError, match="not msgpack"):
        unpack(payload)


MANY = 63 * 2**20
EMPTY_MAPS = b"\x80"
LIST_OF_10_000 = b"\xdc\x27\x10"


@pytest.mark.parametrize(
    "payload",
    [
        b"\xdd" + MANY.to_bytes(4, "big") + EMPTY_MAPS * MANY,
        LIST_OF_10_000 + (LIST_OF_10_000 + EMPTY_MAPS * 10_000) * 6_000,
        (LIST_OF_10_000 + EMPTY_MAPS * 9_999) * 1_000,
        (LIST_OF_10_000 + b"\xa1a" * 9_999) * 400,
        (LIST_OF_10_000 + b"\xa1a" * 9_999) * 400 + b"\xa1a",
        LIST_OF_10_000 * 20_000_000,
        b"\xde\x27\x10" + b"".join(b"\xcd" + n.to_bytes(2, "big") + b"\x80" for n in range(10_000)),
        b"\xdd" + MANY.to_bytes(4, "big") + b"\x00" * MANY,
    ],
    ids=[
        "one list",
        "lists in a list",
        "nested",
        "texts",
        "filled texts",
        "unfilled",
        "one map",
        "numbers",
    ],
)
def test_many_small_values_cost_little_memory(payload: bytes) -> None:
    """63 MiB of empty maps would be 4 GB of objects."""
    tracemalloc.start()
    try:
        with pytest.raises(MessageError, match="not msgpack"):
            unpack(payload)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 100 * 2**20


def test_a_list_or_map_holds_at_most_10_000_items() -> None:
    for many in ([0] * 10_000, dict.fromkeys(map(str, range(10_000)), 0)):
        assert unpack(pack({"a": many}))["a"] == many
    for more in ([0] * 10_001, dict.fromkeys(map(str, range(10_001)), 0)):
        with pytest.raises(MessageError, match="not msgpack"):
            unpack(pack({"a": more}))


def test_lists_and_maps_and_their_items_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wire, "_MAX_VALUES", 10)
    tens: list[Any] = [[0] * 6, [[], [], []], [[1], [2]], {"b": {"c": {}}, "d": 0, "e": 0}]
    for ten in tens:
        assert unpack(pack({"a": ten}))["a"] == ten  # the message itself is a map of two
    for eleven in ([0] * 7, [[1], [], []], [[1], [2, 3]], {"b": {"c": {}}, "d": {}, "e": 0}):
        with pytest.raises(MessageError, match="more than 10 values"):
            unpack(pack({"a": eleven}))


@pytest.mark.parametrize("content", [[], 5, "text", None, {b"schema": SCHEMA}])
def test_what_is_no_map_with_text_keys_is_refused(content: Any) -> None:
    with pytest.raises(MessageError, match="not a map with text keys"):
        unpack(msgpack.packb(content))


@pytest.mark.parametrize(
    "schema", [None, SCHEMA - 1, SCHEMA + 1, float(SCHEMA), str(SCHEMA), [SCHEMA]]
)
def test_another_schema_is_refused(schema: Any) -> None:
    with pytest.raises(MessageError, match="is spoken"):
        unpack(msgpack.packb({"schema": schema}))


def test_no_schema_is_refused() -> None:
    with pytest.raises(MessageError, match="schema None"):
        unpack(msgpack.packb({"run": "r"}))


def test_the_bound_on_size_holds_at_both_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    payload = pack({"data": b"x" * 100})
    monkeypatch.setattr(wire, "MAX_MESSAGE_BYTES", len(payload))
    assert unpack(pack({"data": b"x" * 100}))["data"] == b"x" * 100
    monkeypatch.setattr(wire, "MAX_MESSAGE_BYTES", len(payload) - 1)
    with pytest.raises(MessageError, match="over the bound"):
        pack({"data": b"x" * 100})
    with pytest.raises(MessageError, match="over the bound"):
        unpack(payload)


def test_an_array_travels_as_dtype_shape_and_bytes() -> None:
    message = {"a": np.array([[1, 258]], np.uint16), "in": {"b": np.zeros((0, 84), np.float32)}}
    assert unpack(pack(message)) == {
        "schema": SCHEMA,
        "a": {"dtype": "<u2", "shape": [1, 2], "data": b"\x01\x00\x02\x01"},
        "in": {"b": {"dtype": "<f4", "shape": [0, 84], "data": b""}},
    }
    transposed = pack({"a": np.array([[1, 2], [3, 4]], np.uint8).T})
    assert unpack(transposed)["a"]["data"] == b"\x01\x03\x02\x04"


BLACK = np.zeros((16, 84, 84), np.uint8)
BLOCK = lz4.block.compress(BLACK.tobytes(), store_size=False)


def test_frames_are_compressed_and_noise_is_not() -> None:
    noise = np.random.default_rng(1).integers(256, size=BLACK.shape, dtype=np.uint8)
    for frames, most in ((BLACK, BLACK.nbytes // 200), (noise, noise.nbytes + 50)):
        payload = pack({"frames": frames})
        assert len(payload) <= most
        assert bytes_of(unpack(payload)["frames"]["data"], frames.nbytes) == frames.tobytes()


def test_only_large_arrays_are_compressed() -> None:
    for size, smaller in ((4_095, False), (4_096, True)):
        assert (len(pack({"a": np.zeros(size, np.uint8)})) < size) == smaller


def test_who_compresses_in_another_way_is_understood() -> None:
    best = lz4.block.compress(BLACK.tobytes(), "high_compression", store_size=False)
    assert bytes_of(msgpack.ExtType(1, best), BLACK.nbytes) == BLACK.tobytes()


@pytest.mark.parametrize(
    ("data", "size"),
    [
        *((msgpack.ExtType(1, BLOCK), BLACK.nbytes + more) for more in (-1, 1, -BLACK.nbytes)),
        *((msgpack.ExtType(1, each), BLACK.nbytes) for each in (BLOCK[:-1], BLOCK[1:], b"")),
        (msgpack.ExtType(1, BLOCK * 2), BLACK.nbytes),
        (msgpack.ExtType(1, b""), 0),
        *((each, 3) for each in (b"12", b"1234", "123", [1, 2, 3], None)),
    ],
)
def test_what_does_not_hold_so_many_bytes_is_refused(data: Any, size: int) -> None:
    with pytest.raises(MessageError, match=r"^not (a block of LZ4|the bytes of its shape)"):
        bytes_of(data, size)


@pytest.mark.parametrize("code", [0, 2, 127])
def test_another_extension_is_refused(code: int) -> None:
    with pytest.raises(MessageError, match=f"an extension of type {code}$"):
        unpack(msgpack.packb({"schema": SCHEMA, "data": msgpack.ExtType(code, BLOCK)}))


def test_a_message_is_bounded_as_if_nothing_were_compressed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    noise = np.random.default_rng(1).bytes(10_000)
    whole = len(pack({"a": noise, "b": noise}))
    message = {name: np.zeros(10_000, np.uint8) for name in "ab"}
    assert len(pack(message)) < 300
    monkeypatch.setattr(wire, "MAX_MESSAGE_BYTES", whole + 100)  # dtypes and shapes
    pack(message)
    monkeypatch.setattr(wire, "MAX_MESSAGE_BYTES", whole - 1)
    with pytest.raises(MessageError, match="over the bound"):
        pack(message)


@pytest.mark.parametrize("value", [np.float32(1), {1}, object()])
def test_what_is_neither_plain_nor_an_array_is_not_sent(value: object) -> None:
    with pytest.raises(TypeError, match="cannot hold a"):
        pack({"value": value})


@pytest.mark.parametrize("version", [0, 7, 2**63 - 1])
def test_a_version_is_read(version: int) -> None:
    for signature in (b"", b"signed\n 1"):
        attachment = encode_version(version, "id-1", signature)
        assert decode_version(attachment, "id-1") == (version, signature)


def test_a_version_of_another_run_is_refused() -> None:
    for other in ("id-2", "id", "", "id-1 "):
        with pytest.raises(MessageError, match="weights of another run than id-1"):
            decode_version(encode_version(7, other), "id-1")


@pytest.mark.parametrize(
    "attachment", [b"", b"-1", b"+1", b"1_0", b" 1", b"1.0", b"%d" % 2**63, b"9" * 20, b"9" * 9_999]
)
def test_a_version_that_no_counter_holds_is_refused(attachment: bytes) -> None:
    with pytest.raises(MessageError, match="not a version of weights") as refused:
        decode_version(attachment, "")
    assert len(str(refused.value)) < 200


@pytest.mark.parametrize("depth", [100, 990, 1_015])
def test_what_is_refused_is_told_in_brief(depth: int) -> None:
    """Python's own repr of so deep a list raises RecursionError."""
    deep = b"\x91" * depth + b"\x90"
    with pytest.raises(MessageError) as refused:
        unpack(b"\x81" + msgpack.packb("schema") + deep)
    assert len(str(refused.value)) < 200
