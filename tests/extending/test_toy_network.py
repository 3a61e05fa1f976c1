"""A network of another package learns through the whole pipeline, and acts."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file
from torch import Tensor

from common.errors import InputError
from common.network import build_network
from common.registry import ALGORITHMS
from common.settings.presets import PRESETS
from tests.extending.toy_network import DUELING, DuelingNetwork
from tests.extending.whole_run import RUN, added, learned


def test_a_network_learns_and_acts(tmp_path: Path) -> None:
    fast = PRESETS["fast"]
    config = replace(
        fast,
        learning=replace(fast.learning, algorithm="dueling", batch_size=8, train_period=4),
        replay=replace(fast.replay, capacity=2_000, learning_starts=200),
    )
    with added(ALGORITHMS, DUELING):
        begun = build_network(config, config.action_count).state_dict()
        summary, policy = learned(config, tmp_path, 300)
    assert summary["updates"] >= (300 - 200) // 4
    assert isinstance(policy.network, DuelingNetwork)
    state = load_file(tmp_path / RUN / "checkpoint.safetensors")
    for layer in ("value.weight", "actions.weight", "convolutions.0.weight"):
        assert (state[f"online.{layer}"] != begun[layer].numpy()).any()


def test_a_value_is_the_mean_over_the_actions() -> None:
    learning = replace(PRESETS["fast"].learning, quantiles=2)
    network = DuelingNetwork(3, 4, 0, learning, atoms=2)
    hidden = torch.rand(5, 512)
    outputs = network.outputs(hidden).view(5, 3, 2)
    np.testing.assert_allclose(
        outputs.mean(dim=1).detach(), network.value(hidden).detach(), rtol=1e-4, atol=1e-5
    )


class Flat(DuelingNetwork):
    def atoms(self, frames: Tensor, vectors: Tensor) -> Tensor:
        return super().atoms(frames, vectors).flatten(1)


class Misshaped(DuelingNetwork):
    def outputs(self, hidden: Tensor) -> Tensor:
        return hidden[:, :7]


@pytest.mark.parametrize(
    ("network", "told"),
    [
        (
            Flat,
            r"^Flat.atoms gives torch.float32 \[1, 306\] .*: give float32 \[1, 6, 51\]",
        ),
        (Misshaped, r"^the network of the algorithm dueling fails \(RuntimeError\("),
        (lambda actions: None, r"^the network of the algorithm dueling fails \(TypeError\("),
        ("tests.extending.toy_network:Missing", r"fails \(AttributeError\("),
    ],
)
def test_a_network_that_cannot_be_used_is_told_at_the_start(network: Any, told: str) -> None:
    fast = PRESETS["fast"]
    config = replace(fast, learning=replace(fast.learning, algorithm="dueling"))
    entry = replace(DUELING, network=network)
    with added(ALGORITHMS, entry), pytest.raises(InputError, match=told):
        build_network(config, 6)
