"""Chunks: every valid one survives the wire, and every broken one is refused by name."""

import dataclasses
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import MessageError
from common.protocol.chunk import Chunk, Game
from common.protocol.step_fields import zero_steps
from common.protocol.wire import unpack
from tests.common.protocol.chunk_strategies import chunks, example_chunk, same

ARRAYS = [name for name, value in vars(example_chunk()).items() if isinstance(value, np.ndarray)]
NUMBERS = ["incarnation", "stream", "sequence", "weights_version"]


def message_of(chunk: Chunk) -> dict[str, Any]:
    """What travels, but for its arrays, which are not compressed here."""
    message = unpack(chunk.encode())
    for name in ARRAYS:
        message[name]["data"] = getattr(chunk, name).tobytes()
    return message


def refused(message: dict[str, Any], match: str | None = None) -> None:
    with pytest.raises(MessageError, match=match):
        Chunk.decode(msgpack.packb(message))


@settings(max_examples=50)
@given(chunks())
def test_any_chunk_survives_the_wire(chunk: Chunk) -> None:
    found = Chunk.decode(chunk.encode())
    assert same(found, chunk)
    assert len(found) == len(chunk.actions)


def test_the_arrays_are_views_of_the_message() -> None:
    found = Chunk.decode(example_chunk().encode())
    for name in ARRAYS:
        assert not getattr(found, name).flags.writeable, name
        assert not getattr(found, name).flags.owndata, name


def test_the_message_is_little_larger_than_its_frames() -> None:
    noise = np.random.default_rng(1).integers(256, size=(6, 84, 84), dtype=np.uint8)
    for frames in (noise, np.zeros_like(noise)):
        chunk = example_chunk(frames=frames[:3], context=frames[3:5], final_frames=frames[5:])
        assert len(chunk.encode()) < 1_000 + (frames.nbytes if frames.any() else 100)


@pytest.mark.parametrize("name", [each.name for each in dataclasses.fields(Chunk)])
@pytest.mark.parametrize("value", ["left out", None, {}, b"\x01", -1, float("nan")])
def test_a_field_left_out_or_of_another_kind_is_refused(name: str, value: Any) -> None:
    message = message_of(example_chunk())
    if value == "left out":
        del message[name]
    else:
        message[name] = value
    refused(message, name)


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [-1, True, 1.0, 2**63, "1"])
def test_counters_are_whole_numbers_from_0_on(name: str, value: Any) -> None:
    refused(message_of(example_chunk()) | {name: value}, name)


@pytest.mark.parametrize("name", ["run", "actor"])
@pytest.mark.parametrize("value", [b"run", 5, "x" * 201])
def test_names_are_short_texts(name: str, value: Any) -> None:
    refused(message_of(example_chunk()) | {name: value}, name)


@pytest.mark.parametrize("value", [-0.01, 1.01, float("inf"), True, "0.5"])
def test_epsilon_is_a_share(value: float) -> None:
    refused(message_of(example_chunk()) | {"epsilon": value}, "epsilon")


@pytest.mark.parametrize("name", ARRAYS)
@pytest.mark.parametrize("change", ["dtype", "rank", "longer", "shorter", "data", "no data"])
def test_an_array_of_another_dtype_shape_or_size_is_refused(name: str, change: str) -> None:
    message = message_of(example_chunk())
    packed = message[name]
    itemsize = np.dtype(packed["dtype"]).itemsize
    row = itemsize * int(np.prod(packed["shape"][1:]))
    if change == "dtype":
        packed["dtype"] = "<i8"
    elif change == "rank":
        packed["shape"] = [*packed["shape"], 1]
    elif change == "longer" and name != "context":
        packed["shape"][0] += 1
        packed["data"] += packed["data"][:row]
    elif change == "longer":
        packed["shape"][0] = 16
        packed["data"] = bytes(16 * row)
    elif change == "shorter" and name != "context":
        packed["shape"][0] -= 1
        packed["data"] = packed["data"][:-row]
    elif change == "shorter":
        packed["shape"] = [2, 84, 83]
        packed["data"] = bytes(2 * 84 * 83)
    elif change == "data":
        packed["data"] += b"\x00"
    else:
        packed["data"] = b""
    refused(message)


@pytest.mark.parametrize("steps", [0, 1_025])
def test_a_chunk_has_1_to_1024_steps(steps: int) -> None:
    message = message_of(example_chunk())
    message["actions"] = {"dtype": "|u1", "shape": [steps], "data": bytes(steps)}
    refused(message, f"T is {steps} where 1 to 1024 are allowed")


def test_a_chunk_of_1024_steps_is_taken() -> None:
    steps = 1_024
    chunk = example_chunk(
        **zero_steps(steps) | {"elapsed": np.ones(steps, np.uint8)},
        final_frames=np.zeros((0, 84, 84), np.uint8),
        final_vectors=np.zeros((0, 0), np.float32),
    )
    assert same(Chunk.decode(chunk.encode()), chunk)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"rewards": np.array([0, np.nan, 0], np.float32)}, "finite"),
        ({"rewards": np.array([0, np.inf, 0], np.float32)}, "finite"),
        ({"vectors": np.full((3, 2), np.inf, np.float32)}, "finite"),
        ({"final_vectors": np.full((1, 2), np.nan, np.float32)}, "finite"),
        ({"terminated": np.array([False, False, True])}, "both terminated and truncated"),
        ({"elapsed": np.array([1, 0, 1], np.uint8)}, "at least one agent step"),
        ({"truncated": np.array([False, False, False])}, "final_frames"),
        ({"truncated": np.array([True, False, True])}, "final_frames"),
        ({"final_vectors": np.zeros((1, 3), np.float32)}, "final_vectors"),
        (
            {
                "vectors": np.zeros((3, 1_025), np.float32),
                "final_vectors": np.zeros((1, 1_025), np.float32),
            },
            "P is 1025",
        ),
        ({"games": (Game(0.0, 1),) * 4}, "4 games where 3 at most"),
    ],
)
def test_what_no_actor_could_have_lived_through_is_refused(
    changes: dict[str, Any], match: str
) -> None:
    with pytest.raises(MessageError, match=match):
        Chunk.decode(example_chunk(**changes).encode())


@pytest.mark.parametrize("name", ["terminated", "truncated", "valid", "follows", "matched"])
def test_a_boolean_is_0_or_1(name: str) -> None:
    message = message_of(example_chunk())
    data = message[name]["data"]
    message[name]["data"] = bytes(2 if byte else 0 for byte in data[:-1]) + b"\x02"
    refused(message, name)


@pytest.mark.parametrize(
    "game",
    [
        None,
        5.0,
        [],
        [1.0],
        [1.0, 2, 3],
        ["1", 2],
        [1.0, 2.0],
        [1.0, True],
        [1.0, -1],
        [1.0, 2**31],
        [float("nan"), 2],
        [float("inf"), 2],
        [1e308, 2],
        {"score": 1.0, "steps": 2},
    ],
)
def test_a_game_is_a_score_and_steps(game: Any) -> None:
    refused(message_of(example_chunk()) | {"games": [game]}, "games")


@settings(max_examples=300)
@given(st.data())
def test_flipped_bytes_are_refused_or_make_another_valid_chunk(data: st.DataObject) -> None:
    payload = bytearray(example_chunk().encode())
    for _ in range(data.draw(st.integers(1, 3))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    _refused_or_valid(bytes(payload))


@settings(max_examples=100)
@given(st.data())
def test_a_chunk_cut_short_or_drawn_out_is_refused(data: st.DataObject) -> None:
    body = example_chunk().encode()
    with pytest.raises(MessageError):
        Chunk.decode(body[: data.draw(st.integers(0, len(body) - 1))])
    with pytest.raises(MessageError):
        Chunk.decode(body + data.draw(st.binary(min_size=1, max_size=9)))


@given(st.binary(max_size=300))
def test_random_bytes_are_refused(payload: bytes) -> None:
    with pytest.raises(MessageError):
        Chunk.decode(payload)


def _refused_or_valid(payload: bytes) -> None:
    try:
        found = Chunk.decode(payload)
    except MessageError:
        return
    assert same(Chunk.decode(found.encode()), found)
