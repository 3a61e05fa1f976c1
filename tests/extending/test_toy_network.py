"""A network of another package learns through the whole pipeline, and acts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from safetensors.numpy import load_file

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
