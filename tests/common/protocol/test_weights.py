"""Weights as bytes: all of them arrive, or the network stays as it was."""

import json
import struct

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.torch import save
from torch import Tensor, nn

from common.errors import MessageError
from common.network import QNetwork
from common.protocol.weights import are_finite, encode_weights, load_weights


def small(seed: int = 0) -> nn.Module:
    torch.manual_seed(seed)
    return nn.Sequential(nn.Linear(3, 4), nn.Linear(4, 2))


def tensors(network: nn.Module) -> dict[str, Tensor]:
    return {name: value.clone() for name, value in network.state_dict().items()}


def refused(payload: bytes, match: str | None = None) -> None:
    network = small()
    before = tensors(network)
    with pytest.raises(MessageError, match=match):
        load_weights(network, payload)
    for name, value in network.state_dict().items():
        assert torch.equal(value, before[name])


def test_the_networks_weights_arrive_exactly() -> None:
    torch.manual_seed(0)
    one, other = QNetwork(6), QNetwork(6)
    frames = torch.randint(256, (1, 4, 84, 84), dtype=torch.uint8)
    expected = one(frames, torch.zeros(1, 0))
    assert not torch.equal(other(frames, torch.zeros(1, 0)), expected)
    load_weights(other, encode_weights(one))
    assert torch.equal(other(frames, torch.zeros(1, 0)), expected)
    for name, value in one.state_dict().items():
        assert torch.equal(other.state_dict()[name], value)


def test_float16_arrives_as_float32() -> None:
    one, other = small(1), small(2)
    payload = encode_weights(one, dtype=torch.float16)
    assert len(payload) < len(encode_weights(one))
    load_weights(other, payload)
    for name, value in one.state_dict().items():
        found = other.state_dict()[name]
        assert found.dtype == torch.float32
        assert torch.equal(found, value.half().float())


def test_loaded_weights_are_the_receivers_own() -> None:
    one, other = small(1), small(2)
    load_weights(other, encode_weights(one))
    before = tensors(other)
    with torch.no_grad():
        for weight in one.parameters():
            weight.add_(1)
    for name, value in other.state_dict().items():
        assert torch.equal(value, before[name])


def test_missing_and_unknown_names_are_told() -> None:
    weights = tensors(small())
    weights["1.bia"] = weights.pop("1.bias")
    refused(save(weights), r"weights \['1.bia', '1.bias'\] differ in name")
    refused(save({}), "differ in name")
    refused(save(tensors(small()) | {"more": torch.ones(1)}), r"weights \['more'\] differ in name")


def test_a_learners_checkpoint_is_no_message() -> None:
    weights = tensors(small())
    refused(save({f"online.{name}": value for name, value in weights.items()}), "differ in name")


@pytest.mark.parametrize(
    "value",
    [
        torch.zeros(5, 3),
        torch.zeros(12),
        torch.zeros(3, 4),
        torch.zeros(4, 3, dtype=torch.float64),
        torch.zeros(4, 3, dtype=torch.bfloat16),
        torch.zeros(4, 3, dtype=torch.int32),
    ],
    ids=["longer", "flat", "transposed", "float64", "bfloat16", "int32"],
)
def test_another_shape_or_type_is_told(value: Tensor) -> None:
    refused(save(tensors(small()) | {"0.weight": value}), "0.weight is ")


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_a_single_weight_that_is_no_number_spoils_all(value: float) -> None:
    weights = tensors(small(1))
    weights["1.weight"][1, 3] = value
    refused(save(weights), "1.weight holds a value")


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\x00" * 8,
        b"\xff" * 100,
        struct.pack("<Q", 2**40) + b"{}",
        struct.pack("<Q", 2) + b"[]",
        struct.pack("<Q", 4) + b"\xff\xff\xff\xff",
    ],
)
def test_garbage_is_refused(payload: bytes) -> None:
    refused(payload, "not safetensors")


@pytest.mark.parametrize(
    ("dtype", "shape", "size"),
    [
        *((dtype, [4], 16) for dtype in ("F4", "F8_E4M3", "BOOL", "U64", "", 5)),
        *(("F4", [4], 2), ("F8_E4M3", [4], 4), ("BOOL", [4], 4), ("C64", [4], 32)),
        *(("F32", [0, 2**64 - 1], 0), ("F32", [2, 0, 2**32, 2**32], 0)),
    ],
)
def test_odd_types_and_shapes_in_the_header_are_refused(
    dtype: object, shape: list[int], size: int
) -> None:
    about = {"dtype": dtype, "shape": shape, "data_offsets": [0, size]}
    header = json.dumps({"0.bias": about}).encode()
    refused(struct.pack("<Q", len(header)) + header + bytes(size))


@settings(max_examples=200)
@given(st.data())
def test_a_truncated_message_is_refused(data: st.DataObject) -> None:
    payload = encode_weights(small(1))
    refused(payload[: data.draw(st.integers(0, len(payload) - 1))], "not safetensors")


@settings(max_examples=300)
@given(st.data())
def test_flipped_bytes_are_refused_or_make_other_finite_weights(data: st.DataObject) -> None:
    payload = bytearray(encode_weights(small(1)))
    for _ in range(data.draw(st.integers(1, 4))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    network = small()
    before = tensors(network)
    try:
        load_weights(network, bytes(payload))
    except MessageError:
        for name, value in network.state_dict().items():
            assert torch.equal(value, before[name])
    else:
        assert all(torch.isfinite(value).all() for value in network.state_dict().values())


@pytest.mark.parametrize(
    ("numbers", "finite"),
    [
        ([1.0, -2.0], True),
        ([3e38, 3e38], True),  # though their sum is not
        ([3e38, 3e38, torch.nan], False),
        ([torch.inf, 1.0], False),
        ([torch.inf, -torch.inf], False),
        ([torch.nan], False),
    ],
)
def test_all_weights_have_to_be_finite(numbers: list[float], finite: bool) -> None:
    weights = torch.tensor(numbers)
    assert are_finite([torch.ones(3), weights]) is finite
    assert are_finite([weights, torch.ones(3)]) is finite


def test_weights_of_half_precision_are_summed_in_float32() -> None:
    assert are_finite([torch.full((4,), 6e4, dtype=torch.float16)])
    assert not are_finite([torch.tensor([6e4, torch.inf], dtype=torch.float16)])
