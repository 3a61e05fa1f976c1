"""The mean of the weights that actors play by, worked out by hand and through an algorithm."""

import math
from pathlib import Path

import pytest
import torch

from common.network import QNetwork
from common.protocol.weights import encode_weights
from common.run.network_file import load_network_file
from common.settings.config import LearningConfig
from common.settings.presets import PRESETS
from learner.algorithm.double_dqn import double_dqn
from learner.algorithm.ema import PERIOD, EmaNetwork
from learner.algorithm.value_based import ValueBased
from learner.checkpoint import Checkpoint
from learner.device import Device
from tests.learner.small_batches import learn, random_batch

CPU = Device(torch.device("cpu"), bfloat16=False)


def _algorithm(weights_average: float) -> ValueBased:
    torch.manual_seed(0)
    config = LearningConfig(weights_average=weights_average, learning_rate=1e-2)
    return double_dqn(QNetwork(6), config, CPU)


def _bias(network: QNetwork) -> torch.Tensor:
    bias: torch.Tensor = network.state_dict()["actions.bias"]
    return bias.clone()


def test_the_mean_by_hand() -> None:
    online = QNetwork(6)
    with torch.no_grad():
        online.actions.bias.fill_(8.0)
    mean = EmaNetwork(online, decay=0.75**0.25)
    assert _bias(mean.network).tolist() == [8.0] * 6  # before the first update
    # Of every fourth update: the plain mean of one to four, and the exponential one from there.
    # Before the fourth, the weights themselves.
    for updates, weight, expected in (
        *((1, 5, 5), (3, 7, 7), (4, 6, 6), (5, 9, 6), (8, 0, 3), (12, 9, 5), (16, 1, 4)),
        *((18, 0, 4), (20, 8, 5)),
    ):
        with torch.no_grad():
            online.actions.bias.fill_(weight)
        mean.take(updates)
        assert _bias(mean.network).tolist() == pytest.approx([expected] * 6)
        assert _bias(online).tolist() == [weight] * 6


def test_without_a_decay_the_online_network_itself_is_published() -> None:
    online = QNetwork(6)
    published = EmaNetwork(online, LearningConfig().weights_average)
    before = _bias(online)
    published.take(1)
    assert published.network is online
    assert torch.equal(_bias(online), before)
    assert not any(name.startswith("average.") for name in _algorithm(0.0).state())


def test_an_algorithm_publishes_the_mean_and_learns_without_it() -> None:
    plain, averaged = _algorithm(0.0), _algorithm(0.5**0.25)
    mean = _bias(plain.published)
    assert torch.equal(_bias(averaged.published), mean)
    for updates in range(1, 17):
        batch = random_batch(seed=updates)
        assert torch.equal(learn(plain, batch).loss, learn(averaged, batch).loss)
        if updates <= PERIOD:
            mean = _bias(plain.online)
        elif updates % PERIOD == 0:
            mean = 0.5 * mean + 0.5 * _bias(plain.online)
        torch.testing.assert_close(_bias(averaged.published), mean)
    assert not torch.equal(mean, _bias(plain.published))
    batch = random_batch(seed=9)
    with torch.no_grad():
        values = averaged.published(batch.s_t, batch.x_t).amax(1)
    assert torch.equal(averaged.max_q(batch.s_t, batch.x_t), values)
    assert not torch.equal(plain.max_q(batch.s_t, batch.x_t), values)


@pytest.mark.parametrize("weights_average", [0.0, 0.999])
@pytest.mark.parametrize("prefix", ["online", "average"])
def test_a_weight_that_is_no_number_is_found_before_the_mean_takes_it_in(
    weights_average: float, prefix: str
) -> None:
    algorithm = _algorithm(weights_average)
    for seed in range(5):
        learn(algorithm, random_batch(seed=seed))
    assert algorithm.is_finite()
    network = algorithm.online if prefix == "online" else algorithm.published
    with torch.no_grad():
        network.actions.bias[3] = math.inf
    assert not algorithm.is_finite()


def test_a_checkpoint_keeps_both_and_gives_away_the_mean(tmp_path: Path) -> None:
    path, algorithm = tmp_path / "checkpoint.safetensors", _algorithm(0.9)
    for seed in range(5):
        learn(algorithm, random_batch(seed=seed))
    Checkpoint(path, tmp_path / "previous", algorithm, PRESETS["fast"]).save({})
    played = QNetwork(6)
    load_network_file(played, path, "this game")
    assert encode_weights(played) == encode_weights(algorithm.published)
    assert encode_weights(played) != encode_weights(algorithm.online)
    resumed = _algorithm(0.9)
    Checkpoint(path, tmp_path / "previous", resumed, PRESETS["fast"]).load(print)
    resumed.continue_from(5)
    for each in (algorithm, resumed):
        for seed in range(5, 9):
            learn(each, random_batch(seed=seed))
    for name, value in algorithm.state().items():
        assert torch.equal(resumed.state()[name], value), name
