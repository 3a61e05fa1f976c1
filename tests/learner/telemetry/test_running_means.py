"""Running means against their definition."""

import pytest
import torch

from learner.algorithm.interface import Update
from learner.telemetry.running_means import EVERY, HORIZON, RunningMeans
from tests.learner.small_batches import random_batch


def updated(loss: float, errors: torch.Tensor) -> Update:
    return Update(torch.tensor(loss), errors, {"td_error_squared": errors.square().mean()})


def test_nothing_is_known_before_the_first_update() -> None:
    assert RunningMeans().read() is None


def test_means_weigh_the_latest_most() -> None:
    gauges = RunningMeans()
    losses = [1.0, 2.0, 6.0]
    batches = [random_batch(seed=seed) for seed in range(3)]
    errors = [torch.full((8,), value) for value in (1.0, 3.0, 0.0)]
    for loss, error, batch in zip(losses, errors, batches, strict=True):
        gauges.add(batch, updated(loss, error))
        for _ in range(EVERY - 1):
            gauges.add(batch, updated(1e9, error))  # not looked at
    read = gauges.read()
    assert read is not None
    keep = (1 - 1 / HORIZON) ** EVERY
    weights = [keep**2, keep, 1.0]

    def mean(values: list[float]) -> float:
        return sum(w * v for w, v in zip(weights, values, strict=True)) / sum(weights)

    rewards = [batch.r_t for batch in batches]
    first = mean([float(r.mean()) for r in rewards])
    second = mean([float(r.square().mean()) for r in rewards])
    pixels = mean(
        [sum(float(frame.float().std()) for frame in batch.s_tm1[:, -1]) / 8 for batch in batches]
    )
    expected = (mean(losses), mean([1.0, 9.0, 0.0]), second - first**2, pixels)
    assert read == pytest.approx(expected, rel=1e-4)
