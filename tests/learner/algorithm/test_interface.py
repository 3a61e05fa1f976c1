"""Algorithms by name."""

from dataclasses import replace

import pytest
import torch

from common.network import build_network
from common.registry import ALGORITHMS
from common.settings.config import LearningConfig
from common.settings.presets import PRESETS
from learner.algorithm.interface import build_algorithm
from learner.device import Device
from tests.learner.small_batches import learn, random_batch

CPU = Device(torch.device("cpu"), bfloat16=False)


@pytest.mark.parametrize("name", ALGORITHMS.names)
def test_every_algorithm_learns_with_the_network_that_actors_build(name: str) -> None:
    config = replace(PRESETS["fast"], learning=LearningConfig(algorithm=name, n_step=1))
    algorithm = build_algorithm(config, build_network(config, 6), CPU)
    before = algorithm.published.state_dict()["hidden.bias"].clone()
    result = learn(algorithm, random_batch())
    assert result.loss.shape == ()
    assert result.priorities.shape == (8,)
    assert (result.priorities >= 0).all()
    assert not any(each.requires_grad for each in (result.loss, result.priorities))
    assert not torch.equal(algorithm.published.state_dict()["hidden.bias"], before)
    assert {each for each in algorithm.state() if each.startswith("online.")} == {
        f"online.{name}" for name in build_network(config, 6).state_dict()
    }
