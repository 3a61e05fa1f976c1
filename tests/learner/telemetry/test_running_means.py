"""Running means against their definition."""

import pytest
import torch

from learner.algorithm.interface import Update
from learner.telemetry.running_means import EVERY, HORIZON, PICTURES, RunningMeans
from tests.learner.small_batches import random_batch

TARGETS = torch.tensor([1.0, -1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0])


def updated(loss: float, errors: torch.Tensor, targets: torch.Tensor = TARGETS) -> Update:
    return Update(torch.tensor(loss), errors.abs(), errors, targets)


def test_nothing_is_known_before_the_first_update() -> None:
    assert RunningMeans().values() == {}


def test_means_weigh_the_latest_most() -> None:
    means = RunningMeans()
    losses = [1.0, 2.0, 6.0]
    batches = [random_batch(seed=seed) for seed in range(3)]
    errors = [torch.full((8,), value) for value in (1.0, -3.0, 0.0)]
    for scale, loss, error, batch in zip((1, 2, 3), losses, errors, batches, strict=True):
        means.add(batch, updated(loss, error, scale * TARGETS))
        for _ in range(EVERY - 1):
            means.add(batch, updated(1e9, error))  # not looked at
    keep = (1 - 1 / HORIZON) ** EVERY
    weights = [keep**2, keep, 1.0]

    def mean(values: list[float]) -> float:
        return sum(w * v for w, v in zip(weights, values, strict=True)) / sum(weights)

    pixels = mean(
        [sum(float(frame.float().std()) for frame in batch.s_tm1[:, -1]) / 8 for batch in batches]
    )
    # The targets' mean is 2/8 and their mean square 6/8, before they are scaled.
    variance = mean([0.75, 4 * 0.75, 9 * 0.75]) - mean([0.25, 0.5, 0.75]) ** 2
    expected = {
        "learning/loss": mean(losses),
        "learning/td_error_squared": mean([1.0, 9.0, 0.0]),
        "learning/relative_td_error": mean([1.0, 9.0, 0.0]) / variance,
        "learning/pixel_deviation": pixels,
    }
    assert means.values() == pytest.approx(expected, rel=1e-4)


def test_some_pictures_of_a_large_minibatch_stand_for_all() -> None:
    means, batch = RunningMeans(), random_batch(PICTURES + 8, seed=1)
    batch.s_tm1[PICTURES:, -1] = 0
    expected = batch.s_tm1[:PICTURES, -1].float().std(dim=(1, 2), unbiased=False).mean()
    means.add(batch, updated(1.0, torch.ones(8)))
    assert means.values()["learning/pixel_deviation"] == pytest.approx(float(expected))


@pytest.mark.parametrize("target", [0.0, 0.5, 0.1, 0.3, -0.99, 3.3, 77.7])
def test_targets_that_do_not_vary_say_nothing(target: float) -> None:
    """Nor does what is left of their squares by rounding, which may be negative."""
    means, batch = RunningMeans(), random_batch(seed=1)
    told = updated(1.0, torch.ones(8), torch.full((8,), target))
    for _ in range(50 * EVERY):
        means.add(batch, told)
    assert means.values()["learning/relative_td_error"] is None


@pytest.mark.parametrize("answer", [0.0, 0.25, 7.0])
def test_who_answers_the_same_to_all_explains_nothing(answer: float) -> None:
    """The best constant answer is the mean of the targets. Its error is their variance."""
    means = RunningMeans()
    means.add(random_batch(seed=1), updated(1.0, TARGETS - answer))
    expected = 1 + (answer - 0.25) ** 2 / (0.75 - 0.25**2)
    assert means.values()["learning/relative_td_error"] == pytest.approx(expected)


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


@pytest.mark.parametrize("loss", [float("nan"), float("inf"), -float("inf")])
def test_a_minibatch_that_is_not_finite_does_not_count(loss: float) -> None:
    spoilt = updated(loss, torch.full((8,), loss)), random_batch(seed=1)
    whole = [(updated(loss, loss * TARGETS), random_batch(seed=int(loss))) for loss in (2.0, 5.0)]
    told = []
    for updates in ([spoilt, whole[0], spoilt, whole[1], spoilt], whole):
        means = RunningMeans()
        for result, batch in updates:
            for _ in range(EVERY):
                means.add(batch, result)
        told.append(means.values())
    assert told[0] == told[1]
    assert told[0].keys() >= {"learning/loss", "learning/pixel_deviation"}


def test_a_minibatch_that_is_too_large_to_be_added_does_not_count() -> None:
    means = RunningMeans()
    for loss in (3e38, 3e38, 1.0):
        for _ in range(EVERY):
            means.add(random_batch(), updated(loss, torch.zeros(8)))
    assert 0 < float(means.values()["learning/loss"] or 0) < 3e38


def test_nothing_is_known_while_no_minibatch_is_finite() -> None:
    means = RunningMeans()
    means.add(random_batch(), updated(float("nan"), torch.full((8,), float("nan"))))
    assert means.values() == {}
