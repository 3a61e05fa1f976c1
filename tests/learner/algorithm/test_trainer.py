"""The update as a whole, against an update written out plainly."""

import copy
from dataclasses import replace
from typing import Literal

import pytest
import torch

from common.network import QNetwork
from common.run.config import LearningConfig
from learner.algorithm.precision import HalfPrecision
from learner.algorithm.trainer import Trainer
from learner.device import Device
from tests.learner.small_batches import random_batch

CPU = Device(torch.device("cpu"), bfloat16=False)


def _network(seed: int = 0) -> QNetwork:
    torch.manual_seed(seed)
    return QNetwork(6)


@pytest.mark.parametrize("target", ["dqn", "double"])
def test_an_update_is_the_plain_one(target: Literal["dqn", "double"]) -> None:
    config = LearningConfig(
        target=target, loss="mse", optimizer="rmsprop", learning_rate=1e-3, gradient_norm=0.0
    )
    trainer = Trainer(_network(), config, CPU)
    other = _network(1)  # a target network that differs, so that the two targets do
    trainer.target.load_state_dict(other.state_dict())
    plain = copy.deepcopy(trainer.online)
    batch = random_batch()

    result = trainer.update(batch)

    rows = torch.arange(8)
    with torch.no_grad():
        chooser = other if target == "dqn" else plain
        best = chooser(batch.s_t, batch.x_t).argmax(1)
        values = other(batch.s_t, batch.x_t)[rows, best]
    errors = batch.r_t + 0.9 * values - plain(batch.s_tm1, batch.x_tm1)[rows, batch.a_tm1]
    loss = errors.square().mean()
    optimizer = torch.optim.RMSprop(plain.parameters(), lr=1e-3, alpha=0.95, eps=1.5e-4)
    loss.backward()  # type: ignore[no-untyped-call]
    optimizer.step()
    assert float(result.loss) == pytest.approx(float(loss.detach()), rel=1e-4)
    torch.testing.assert_close(result.td_errors, errors.detach(), rtol=1e-3, atol=1e-4)
    for ours, theirs in zip(trainer.online.parameters(), plain.parameters(), strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-3, atol=1e-5)


def test_the_gradient_is_bounded() -> None:
    config = LearningConfig(gradient_norm=0.01)
    trainer = Trainer(_network(), config, CPU)
    batch = random_batch()
    trainer.update(batch._replace(r_t=batch.r_t * 1000))
    norm = torch.stack([p.grad.norm() for p in trainer.online.parameters() if p.grad is not None])
    assert float(norm.norm()) == pytest.approx(0.01, rel=1e-3)


def test_the_target_network_stands_still_until_it_is_copied() -> None:
    trainer = Trainer(_network(), LearningConfig(), CPU)
    before = copy.deepcopy(trainer.target.state_dict())
    for seed in range(3):
        trainer.update(random_batch(seed=seed))
    for name, value in trainer.target.state_dict().items():
        assert torch.equal(value, before[name])
        assert not torch.equal(value, trainer.online.state_dict()[name])
    trainer.copy_to_target()
    for name, value in trainer.target.state_dict().items():
        assert torch.equal(value, trainer.online.state_dict()[name])


def test_what_was_prepared_with_an_older_target_is_prepared_again() -> None:
    batch = random_batch()
    errors = []
    for early in (True, False):
        trainer = Trainer(_network(), LearningConfig(), CPU)
        trainer.target.load_state_dict(_network(1).state_dict())
        prepared = trainer.prepare(batch)
        trainer.copy_to_target()
        if not early:
            prepared = trainer.prepare(batch)
        errors.append(trainer.learn(prepared).td_errors)
    assert torch.equal(*errors)


def test_bfloat16_is_what_autocast_computes() -> None:
    config = LearningConfig(loss="mse", gradient_norm=0.0)
    trainer = Trainer(_network(), config, Device(torch.device("cpu"), bfloat16=True))
    trainer.target.load_state_dict(_network(1).state_dict())
    plain, other = copy.deepcopy(trainer.online), copy.deepcopy(trainer.target)
    batch = random_batch()

    result = trainer.update(batch)

    rows = torch.arange(8)
    with torch.autocast("cpu", torch.bfloat16):
        best = plain(batch.s_t, batch.x_t).argmax(1)
        values = other(batch.s_t, batch.x_t)[rows, best].detach()
        errors = batch.r_t + 0.9 * values - plain(batch.s_tm1, batch.x_tm1)[rows, batch.a_tm1]
    errors.square().mean().backward()  # type: ignore[no-untyped-call]
    torch.testing.assert_close(result.td_errors, errors.detach(), rtol=1e-2, atol=1e-3)
    for ours, theirs in zip(trainer.online.parameters(), plain.parameters(), strict=True):
        assert ours.grad is not None
        assert theirs.grad is not None
        assert ours.dtype == ours.grad.dtype == torch.float32
        away = (ours.grad - theirs.grad).norm() / theirs.grad.norm()
        assert away < 0.01  # bfloat16 has 8 bits: 0.4 %


def test_half_precision_follows_weights_that_are_loaded() -> None:
    original = _network()
    half = HalfPrecision(original)
    assert {p.dtype for p in half.network.hidden.parameters()} == {torch.bfloat16}
    original.load_state_dict(_network(1).state_dict())
    for ours, theirs in zip(half.network.parameters(), original.parameters(), strict=True):
        assert torch.equal(ours, theirs.to(ours.dtype))


def test_importance_weights_scale_the_loss() -> None:
    config = LearningConfig(loss="mse")
    batch = random_batch()
    whole = Trainer(_network(), config, CPU).update(batch).loss
    half = Trainer(_network(), config, CPU).update(batch._replace(weights=batch.weights / 2)).loss
    assert float(half) == pytest.approx(float(whole) / 2)


def test_bfloat16_follows_float32_over_many_updates() -> None:
    """The faster precision learns the same: losses within 2 % over 60 updates of fixed data."""
    config = replace(LearningConfig(), learning_rate=1e-4)
    losses = []
    for bfloat16 in (False, True):
        trainer = Trainer(_network(), config, Device(torch.device("cpu"), bfloat16))
        found = [float(trainer.update(random_batch(seed=step % 4)).loss) for step in range(60)]
        assert sum(found[-4:]) < 0.8 * sum(found[:4])
        losses.append(sum(found))
    assert losses[1] == pytest.approx(losses[0], rel=0.02)


def test_max_q_is_each_states_highest_value() -> None:
    trainer = Trainer(_network(), LearningConfig(), CPU)
    batch = random_batch(size=300)
    values = trainer.max_q(batch.s_t, batch.x_t)
    with torch.no_grad():
        expected = trainer.online(batch.s_t, batch.x_t).max(dim=1).values
    assert values.shape == (300,)
    torch.testing.assert_close(values, expected, rtol=1e-4, atol=1e-5)
