"""Running means against their definition."""

import pytest
import torch

from learner.algorithm.interface import Update
from learner.telemetry.running_means import EVERY, HORIZON, RunningMeans
from tests.learner.small_batches import random_batch


def updated(loss: float, errors: torch.Tensor) -> Update:
    return Update(torch.tensor(loss), errors, {"td_error_squared": errors.square().mean()})


def test_nothing_is_known_before_the_first_update() -> None:
    assert RunningMeans().values() == {}


def test_means_weigh_the_latest_most() -> None:
    means = RunningMeans()
    losses = [1.0, 2.0, 6.0]
    batches = [random_batch(seed=seed) for seed in range(3)]
    errors = [torch.full((8,), value) for value in (1.0, 3.0, 0.0)]
    for loss, error, batch in zip(losses, errors, batches, strict=True):
        means.add(batch, updated(loss, error))
        for _ in range(EVERY - 1):
            means.add(batch, updated(1e9, error))  # not looked at
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
    expected = {
        "learning/loss": mean(losses),
        "learning/td_error_squared": mean([1.0, 9.0, 0.0]),
        "learning/relative_td_error": mean([1.0, 9.0, 0.0]) / (second - first**2),
        "learning/pixel_deviation": pixels,
    }
    assert means.values() == pytest.approx(expected, rel=1e-4)


def test_rewards_that_do_not_vary_say_nothing() -> None:
    means = RunningMeans()
    batch = random_batch(seed=1)
    batch.r_t.fill_(0.5)
    means.add(batch, updated(1.0, torch.ones(8)))
    assert means.values()["learning/relative_td_error"] is None


def test_what_an_algorithm_tells_is_a_figure_of_its_own() -> None:
    means = RunningMeans()
    told = updated(1.0, torch.ones(8))
    told = told._replace(metrics={**told.metrics, "spread": torch.tensor(0.25)})
    means.add(random_batch(seed=1), told)
    assert means.values()["learning/spread"] == 0.25


def test_an_algorithm_that_tells_other_figures_now_and_then_is_refused() -> None:
    means = RunningMeans()
    batch, told = random_batch(seed=1), updated(1.0, torch.ones(8))
    means.add(batch, told)
    other = told._replace(metrics={**told.metrics, "spread": torch.tensor(0.25)})
    for _ in range(EVERY - 1):
        means.add(batch, other)  # not looked at
    with pytest.raises(ValueError, match="return the same metrics from every update"):
        means.add(batch, other)


def test_a_loss_that_is_not_finite_does_not_stay() -> None:
    means = RunningMeans()
    for loss in (float("nan"), 1.0, 1.0):
        for _ in range(EVERY):
            means.add(random_batch(), updated(loss, torch.full((8,), loss)))
    assert means.values()["learning/loss"] == pytest.approx(2 / 3, rel=0.02)
