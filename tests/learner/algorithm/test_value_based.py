"""The update as a whole, against an update written out plainly."""

import copy
from dataclasses import replace
from typing import Literal

import pytest
import torch

from common.network import QNetwork
from common.settings.config import LearningConfig, NetworkName
from common.settings.presets import PRESETS
from learner.algorithm.double_dqn import double_dqn
from learner.algorithm.precision import Bfloat16Precision, NativePrecision, precision_of
from learner.algorithm.target_network import TargetNetwork
from learner.algorithm.value_based import ValueBased
from learner.device import Device
from tests.extending.toy_algorithm import RandomPolicyLoss, Settings
from tests.learner.small_batches import learn, random_batch
from tests.native import needs_native

CPU = Device(torch.device("cpu"), bfloat16=False)
CPU_BFLOAT16 = Device(torch.device("cpu"), bfloat16=True)
CPU_NATIVE = replace(CPU_BFLOAT16, native="avx512_bf16")
NATIVE = [
    pytest.param(CPU_NATIVE, marks=needs_native("avx512_bf16")),
    pytest.param(replace(CPU, native="avx2"), marks=needs_native("avx2")),
    pytest.param(replace(CPU, native="avx512"), marks=needs_native("avx512")),
]


def _network(seed: int = 0, width: int = 0) -> QNetwork:
    torch.manual_seed(seed)
    return QNetwork(6, vector_width=width)


def _target_of(algorithm: ValueBased) -> dict[str, torch.Tensor]:
    state = algorithm.state()
    return {
        name.removeprefix("target."): value.clone()
        for name, value in state.items()
        if name.startswith("target.")
    }


def _with_target(algorithm: ValueBased, target: QNetwork) -> ValueBased:
    """Returns ``algorithm`` with another target network."""
    changed = {f"target.{name}": value for name, value in target.state_dict().items()}
    algorithm.load_state(algorithm.state() | changed)
    return algorithm


@pytest.mark.parametrize("target", ["dqn", "double"])
def test_an_update_is_the_plain_one(target: Literal["dqn", "double"]) -> None:
    config = LearningConfig(
        target=target, loss="mse", optimizer="rmsprop", learning_rate=1e-3, gradient_norm=0.0
    )
    other = _network(1, width=900)  # a target network that differs, so that the two targets do
    algorithm = _with_target(double_dqn(_network(width=900), config, CPU), other)
    plain = copy.deepcopy(algorithm.online)
    batch = random_batch(width=900)

    result = learn(algorithm, batch)

    rows = torch.arange(8)
    with torch.no_grad():
        chooser = other if target == "dqn" else plain
        best = chooser(batch.s_t, batch.x_t).argmax(1)
        values = other(batch.s_t, batch.x_t)[rows, best]
    targets = batch.r_t + 0.9 * values
    errors = targets - plain(batch.s_tm1, batch.x_tm1)[rows, batch.a_tm1]
    loss = errors.square().mean()
    optimizer = torch.optim.RMSprop(plain.parameters(), lr=1e-3, alpha=0.95, eps=1.5e-4)
    loss.backward()
    optimizer.step()
    assert float(result.loss) == pytest.approx(float(loss.detach()), rel=1e-4)
    expected = errors.detach()
    torch.testing.assert_close(result.priorities, expected.abs(), rtol=1e-3, atol=1e-4)
    torch.testing.assert_close(result.td_errors, expected, rtol=1e-3, atol=1e-4)
    torch.testing.assert_close(result.targets, targets, rtol=1e-3, atol=1e-4)
    for ours, theirs in zip(algorithm.online.parameters(), plain.parameters(), strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-3, atol=1e-5)


def test_what_an_update_tells_keeps_no_gradient() -> None:
    algorithm = ValueBased(_network(), RandomPolicyLoss(Settings()), LearningConfig(), CPU)
    result = learn(algorithm, random_batch())
    told = (*result[:-1], *result.metrics.values())
    assert not any(each.requires_grad for each in told)


@pytest.mark.parametrize("optimizer", ["adam", "rmsprop"])
def test_the_learning_rate_falls_and_goes_on_falling_after_a_resume(
    optimizer: Literal["adam", "rmsprop"],
) -> None:
    config = LearningConfig(
        optimizer=optimizer,
        learning_rate=1e-3,
        annealing_steps=16,
        final_learning_rate=0.0,
        train_period=4,
    )
    rates = [config.learning_rate_at(updates) for updates in range(6)]
    assert rates == pytest.approx([1e-3, 7.5e-4, 5e-4, 2.5e-4, 0, 0])
    batch = random_batch()
    algorithm = double_dqn(_network(), config, CPU)
    for _ in range(4):
        learn(algorithm, batch)
    resumed = double_dqn(_network(), config, CPU)
    resumed.load_state(algorithm.state())
    for updates, moves in ((4, False), (3, True)):
        resumed.continue_from(updates)
        before = copy.deepcopy(resumed.online.state_dict())
        learn(resumed, batch)
        after = resumed.online.state_dict()
        assert any(not torch.equal(before[name], after[name]) for name in before) is moves


def test_the_gradient_is_bounded() -> None:
    config = LearningConfig(gradient_norm=0.01)
    algorithm = double_dqn(_network(), config, CPU)
    batch = random_batch()
    learn(algorithm, batch._replace(r_t=batch.r_t * 1000))
    norm = torch.stack([p.grad.norm() for p in algorithm.online.parameters() if p.grad is not None])
    assert float(norm.norm()) == pytest.approx(0.01, rel=1e-3)


def test_the_target_network_stands_still_until_its_period_is_over() -> None:
    config = LearningConfig(target_update_period=4)
    algorithm = double_dqn(_network(), config, CPU)
    before = _target_of(algorithm)
    for seed in range(3):
        learn(algorithm, random_batch(seed=seed))
    for name, value in _target_of(algorithm).items():
        assert torch.equal(value, before[name])
        assert not torch.equal(value, algorithm.online.state_dict()[name])
    learn(algorithm, random_batch(seed=3))
    for name, value in _target_of(algorithm).items():
        assert torch.equal(value, algorithm.online.state_dict()[name])


def test_the_targets_period_goes_on_where_an_earlier_process_left_it() -> None:
    algorithm = double_dqn(_network(), LearningConfig(target_update_period=4), CPU)
    algorithm.continue_from(8 + 2)
    for synced in (False, True, False):
        learn(algorithm, random_batch())
        online = algorithm.online.state_dict()
        target = _target_of(algorithm)
        assert all(torch.equal(value, target[name]) for name, value in online.items()) == synced


@pytest.mark.parametrize("device", [CPU, CPU_BFLOAT16, *NATIVE])
def test_what_was_prepared_with_an_older_target_is_prepared_again(device: Device) -> None:
    batch = random_batch()
    priorities = []
    for early in (True, False):
        config = LearningConfig(target_update_period=1)
        algorithm = _with_target(double_dqn(_network(), config, device), _network(1))
        prepared = algorithm.prepare(batch)
        learn(algorithm, random_batch(seed=1))  # after which the target network is another
        if not early:
            prepared = algorithm.prepare(batch)
        priorities.append(algorithm.update(prepared).priorities)
    assert torch.equal(*priorities)


@pytest.mark.parametrize(
    ("device", "tolerance"),
    # bfloat16 has 8 bits: 0.4 %. The kernel rounds elsewhere: sums, for example, not at all.
    [
        (CPU_BFLOAT16, 0.01),
        pytest.param(CPU_NATIVE, 0.05, marks=needs_native("avx512_bf16")),
    ],
)
def test_bfloat16_is_what_autocast_computes(device: Device, tolerance: float) -> None:
    config = LearningConfig(loss="mse", gradient_norm=0.0)
    other = _network(1)
    algorithm = _with_target(double_dqn(_network(), config, device), other)
    plain = copy.deepcopy(algorithm.online)
    batch = random_batch()

    result = learn(algorithm, batch)

    rows = torch.arange(8)
    with torch.autocast("cpu", torch.bfloat16):
        best = plain(batch.s_t, batch.x_t).argmax(1)
        values = other(batch.s_t, batch.x_t)[rows, best].detach()
        errors = batch.r_t + 0.9 * values - plain(batch.s_tm1, batch.x_tm1)[rows, batch.a_tm1]
    errors.square().mean().backward()
    torch.testing.assert_close(result.priorities, errors.detach().abs(), rtol=1e-2, atol=1e-3)
    for ours, theirs in zip(algorithm.online.parameters(), plain.parameters(), strict=True):
        assert ours.grad is not None
        assert theirs.grad is not None
        assert ours.dtype == ours.grad.dtype == torch.float32
        away = (ours.grad - theirs.grad).norm() / theirs.grad.norm()
        assert away < tolerance


def test_a_bfloat16_copy_takes_over_weights_that_are_loaded() -> None:
    original = _network()
    half = precision_of(original, CPU_BFLOAT16)
    assert {p.dtype for p in half.network.hidden.parameters()} == {torch.bfloat16}
    original.load_state_dict(_network(1).state_dict())
    for ours, theirs in zip(half.network.parameters(), original.parameters(), strict=True):
        assert torch.equal(ours, theirs.to(ours.dtype))


@pytest.mark.parametrize("device", NATIVE)
@pytest.mark.parametrize("learning", [LearningConfig(), PRESETS["paper"].learning])
def test_an_update_by_the_native_kernel_has_its_optimizers_step_too(
    learning: LearningConfig, device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    algorithm = double_dqn(_network(), learning, device)
    monkeypatch.setattr(algorithm._optimizer._optimizer, "step", None)  # PyTorch's
    before = algorithm.online.state_dict()["hidden.weight"].clone()
    for _ in range(2):
        learn(algorithm, random_batch())
    assert not torch.equal(algorithm.online.state_dict()["hidden.weight"], before)


@pytest.mark.parametrize("device", NATIVE)
def test_the_native_kernel_goes_on_with_loaded_weights_and_after_each_update(
    device: Device,
) -> None:
    """It has a copy of the weights, which would be out of date otherwise."""
    algorithm, other = (double_dqn(_network(seed), LearningConfig(), device) for seed in (0, 1))
    learn(other, random_batch())
    algorithm.load_state({name: value.clone() for name, value in other.state().items()})
    algorithm.continue_from(1)  # whose learning rate is that of the second update
    batch = random_batch(seed=2)
    for each in (algorithm, other):
        learn(each, batch)
    for (name, ours), theirs in zip(
        algorithm.online.state_dict().items(), other.online.state_dict().values(), strict=True
    ):
        assert torch.equal(ours, theirs), name
    with torch.no_grad():
        computed = algorithm._precision.network(batch.s_t, batch.x_t)
        torch.testing.assert_close(
            computed, algorithm.online(batch.s_t, batch.x_t), rtol=0.02, atol=0.02
        )


@pytest.mark.parametrize("device", NATIVE)
@pytest.mark.parametrize(("network", "native"), [("nature", True), ("nips", False)])
def test_only_networks_that_the_kernel_knows_are_its(
    network: NetworkName, native: bool, device: Device
) -> None:
    precision = precision_of(QNetwork(6, learning=LearningConfig(network=network)), device)
    assert isinstance(precision, NativePrecision) is native


def test_importance_weights_scale_the_loss_and_nothing_else() -> None:
    config = LearningConfig(loss="mse")
    batch = random_batch()
    whole, half = (
        learn(double_dqn(_network(), config, CPU), batch._replace(weights=weights))
        for weights in (batch.weights, batch.weights / 2)
    )
    assert float(half.loss) == pytest.approx(float(whole.loss) / 2)
    torch.testing.assert_close(half.priorities, whole.priorities)
    torch.testing.assert_close(half.td_errors, whole.td_errors)


def test_a_sync_of_the_target_leaves_the_online_copy_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    algorithm = double_dqn(_network(), LearningConfig(), CPU_BFLOAT16)
    synced: list[Bfloat16Precision] = []
    monkeypatch.setattr(Bfloat16Precision, "sync_from_master", lambda self: synced.append(self))
    algorithm._target.sync(algorithm.online)
    assert synced == [algorithm._target._precision]


def test_the_target_network_is_not_synced_while_it_is_evaluated() -> None:
    """Or its outputs would be those of old and of new weights."""
    target, held = TargetNetwork(_network(), CPU), list[bool]()
    target.network.register_load_state_dict_post_hook(  # type: ignore[no-untyped-call]
        lambda *_: held.append(target._lock.locked())
    )
    assert target.evaluate(lambda _: target._lock.locked()) == (True, 0)
    target.sync(_network(1))
    assert held == [True]


@pytest.mark.parametrize("device", [CPU_BFLOAT16, *NATIVE])
def test_other_arithmetic_follows_float32_over_many_updates(device: Device) -> None:
    """The faster precision learns the same: losses within 2 % over 60 updates of fixed data."""
    config = replace(LearningConfig(), learning_rate=1e-4)
    losses = []
    for each in (CPU, device):
        algorithm = double_dqn(_network(), config, each)
        found = [float(learn(algorithm, random_batch(seed=step % 4)).loss) for step in range(60)]
        assert sum(found[-4:]) < 0.8 * sum(found[:4])
        losses.append(sum(found))
    assert losses[1] == pytest.approx(losses[0], rel=0.02)


def test_max_q_is_each_states_highest_value() -> None:
    algorithm = double_dqn(_network(), LearningConfig(), CPU)
    batch = random_batch(size=300)
    values = algorithm.max_q(batch.s_t, batch.x_t)
    with torch.no_grad():
        expected = algorithm.online(batch.s_t, batch.x_t).max(dim=1).values
    assert values.shape == (300,)
    torch.testing.assert_close(values, expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("device", [CPU, CPU_BFLOAT16, *NATIVE])
@pytest.mark.parametrize("optimizer", ["adam", "rmsprop"])
@pytest.mark.parametrize("reward", [float("nan"), float("inf")])
def test_a_minibatch_that_is_not_finite_changes_no_weight(
    device: Device, optimizer: Literal["adam", "rmsprop"], reward: float
) -> None:
    """Neither does it stay in the optimizer's means, by which every later step would go.

    The gradient of an infinite Huber loss is finite.
    """
    algorithm, never = (
        double_dqn(_network(), LearningConfig(optimizer=optimizer), device) for _ in range(2)
    )
    good, bad, last = (random_batch(seed=seed) for seed in range(3))
    bad.r_t[3] = reward
    for each in (algorithm, never):
        learn(each, good)
    result = learn(algorithm, bad)
    assert not result.loss.isfinite()
    assert (~result.priorities.isfinite()).nonzero().flatten().tolist() == [3]
    for each in (algorithm, never):
        learn(each, last)
    ours, theirs = algorithm.state(), never.state()
    for name, value in ours.items():
        assert torch.equal(value, theirs[name]), name


@pytest.mark.parametrize("average", [0.0, 0.9])
def test_a_state_with_other_networks_is_refused(average: float) -> None:
    """One that publishes the mean of its weights has one network more."""
    mine, other = (
        double_dqn(_network(), LearningConfig(weights_average=each), CPU)
        for each in (average, 0.9 - average)
    )
    mine.load_state(mine.state())
    with pytest.raises(ValueError, match="it holds other tensors"):
        mine.load_state(other.state())


def test_hidden_units_are_normalised_in_float32_whatever_the_precision() -> None:
    torch.manual_seed(0)
    learning = LearningConfig(layer_norm=True)
    algorithm = double_dqn(QNetwork(6, learning=learning), learning, CPU_BFLOAT16)
    norm = algorithm._precision.network.norm
    assert norm is not None
    seen: list[torch.dtype] = []
    norm.register_forward_pre_hook(lambda _, given: seen.append(given[0].dtype))
    before = norm.weight.detach().clone()
    assert learn(algorithm, random_batch()).loss.isfinite()
    assert set(seen) == {torch.float32}
    assert not torch.equal(norm.weight, before)
