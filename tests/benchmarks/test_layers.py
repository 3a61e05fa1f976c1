"""The arithmetic of an update's layers."""

import pytest
import torch

from benchmarks.layers import layers_of, time_layers
from benchmarks.peer_update import DOUBLE_DQN
from common.network import build_network


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_multiplications_of_an_update(dtype: torch.dtype) -> None:
    layers = list(layers_of(build_network(DOUBLE_DQN, 6), 2, dtype))
    assert [(layer.name, layer.product) for layer in layers] == [
        ("convolution 4×8×8×32", (2 * 20 * 20, 256, 32)),
        ("convolution 32×4×4×64", (2 * 9 * 9, 512, 64)),
        ("convolution 64×3×3×64", (2 * 7 * 7, 576, 64)),
        ("dense 3136×512", (2, 3136, 512)),
        ("dense 512×6", (2, 512, 6)),
    ]
    rows = time_layers(layers, 2)
    # Three forward passes and the weights' gradients; the input's, but for the first layer.
    first, second = 2 * 400 * 256 * 32, 2 * 81 * 512 * 64
    assert rows[0]["million"] == pytest.approx(4 * first / 1e6)
    assert rows[1]["million"] == pytest.approx(5 * second / 1e6)
    *each, whole = rows
    assert whole["million"] == pytest.approx(sum(row["million"] for row in each))
    assert whole["ms"] == pytest.approx(sum(row["ms"] for row in each))
    assert whole["per ns"] == pytest.approx(whole["million"] / whole["ms"])
    assert whole["one product, per ns"] == max(row["one product, per ns"] for row in each)
