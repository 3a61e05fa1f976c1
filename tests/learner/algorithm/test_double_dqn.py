"""Equations 2 to 4 against values worked out by hand."""

from typing import Any

import pytest
import torch
from torch import tensor

from common.settings.config import LearningConfig
from learner.algorithm.double_dqn import (
    DoubleDqnLoss,
    bootstrap_values,
    td_errors,
    td_loss,
    td_targets,
)
from learner.algorithm.interface import Prepared
from tests.learner.small_batches import random_batch

Q_TARGET = tensor([[1.0, 3.0, 2.0], [0.0, -1.0, -2.0]])
Q_ONLINE = tensor([[5.0, 4.0, 6.0], [1.0, 2.0, 0.0]])


def test_dqn_takes_the_target_networks_maximum() -> None:
    assert bootstrap_values(Q_TARGET, None).tolist() == [3.0, 0.0]


def test_double_dqn_lets_the_online_network_choose() -> None:
    # The online network prefers actions 2 and 1, which the target network values 2 and -1.
    assert bootstrap_values(Q_TARGET, Q_ONLINE).tolist() == [2.0, -1.0]


def test_td_error() -> None:
    targets = td_targets(
        r_t=tensor([1.0, -1.0]), discount_t=tensor([0.9, 0.0]), v_t=tensor([2.0, 100.0])
    )
    # 1 + 0.9·2, and at a terminal -1.
    assert targets.tolist() == pytest.approx([2.8, -1.0])
    errors = td_errors(tensor([[0.5, 1.5], [2.0, 4.0]]), tensor([1, 0]), targets)
    assert errors.tolist() == pytest.approx([2.8 - 1.5, -1 - 2])


def test_the_gradient_flows_through_the_chosen_value_alone() -> None:
    q_tm1 = tensor([[0.5, 1.5]], requires_grad=True)
    v_t = tensor([2.0], requires_grad=True)
    errors = td_errors(q_tm1, tensor([1]), td_targets(tensor([0.0]), tensor([0.9]), v_t))
    errors.sum().backward()  # type: ignore[no-untyped-call]
    assert q_tm1.grad is not None
    assert q_tm1.grad.tolist() == [[0.0, -1.0]]
    assert v_t.grad is None


@pytest.mark.parametrize(
    ("kind", "outputs", "expected"),
    [
        # δ = 0.5, -2, 1 with weights 1, 0.5, 1
        ("mse", 1, (0.25 + 0.5 * 4 + 1) / 3),
        ("mse", 6, (0.25 + 0.5 * 4 + 1) / 18),
        ("huber", 1, (0.125 + 0.5 * 1.5 + 0.5) / 3),
    ],
)
def test_losses(kind: str, outputs: int, expected: float) -> None:
    errors, weights = tensor([0.5, -2.0, 1.0]), tensor([1.0, 0.5, 1.0])
    assert float(td_loss(errors, weights, kind, outputs)) == pytest.approx(expected)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("loss", "over", "expected"),
    [
        # δ = 0.5 and -3
        ("mse", "batch", (0.25 + 9) / 2),
        ("mse", "outputs", (0.25 + 9) / 6),
        ("huber", "batch", (0.125 + 2.5) / 2),
    ],
)
def test_the_settings_choose_the_loss(loss: Any, over: Any, expected: float) -> None:
    q = tensor([[0.5, 1.5, 0.0], [2.0, 4.0, 0.0]])
    batch = random_batch(size=2)._replace(
        a_tm1=tensor([1, 0]), r_t=tensor([2.0, -1.0]), discount_t=tensor([0.0, 0.0])
    )
    prepared = Prepared(batch, batch.s_tm1, batch.s_t, target_outputs=(q,))
    network: Any = lambda pixels, vectors: q  # noqa: E731
    found = DoubleDqnLoss(LearningConfig(loss=loss, loss_mean_over=over))(network, prepared)
    assert float(found.loss) == pytest.approx(expected)


def test_the_2017_loss_is_keras_mean_over_all_outputs() -> None:
    """Keras got the network's own values as targets, but for the action that was taken."""
    torch.manual_seed(0)
    q = torch.randn(32, 6)
    actions = torch.randint(6, (32,))
    errors = torch.randn(32)
    targets = q.clone()
    targets[torch.arange(32), actions] += errors
    keras = torch.nn.functional.mse_loss(q, targets)
    assert float(td_loss(errors, torch.ones(32), "mse", 6)) == pytest.approx(float(keras), rel=1e-5)


def test_huber_is_pytorchs() -> None:
    errors = torch.linspace(-3, 3, 101)
    theirs = torch.nn.functional.huber_loss(errors, torch.zeros(101))
    assert float(td_loss(errors, torch.ones(101), "huber")) == pytest.approx(float(theirs))
