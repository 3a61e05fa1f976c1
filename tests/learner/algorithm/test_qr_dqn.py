"""QR-DQN against values worked out by hand, a float64 version in loops, and a tiny problem."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from torch import Tensor, tensor

from common.native.library import InstructionSet
from common.native.quantile_huber import native_quantile_huber
from common.network import QNetwork, build_network
from common.settings.config import LearningConfig
from common.settings.presets import PRESETS
from learner.algorithm.qr_dqn import of_action, qr_dqn, quantile_huber, target_quantiles
from learner.device import Device
from tests.learner.small_batches import learn, random_batch
from tests.native import INSTRUCTION_SETS, torch_threads

Losses = Callable[[Tensor, Tensor], Tensor]
CPU = Device(torch.device("cpu"), bfloat16=False)
CPU_BFLOAT16 = Device(torch.device("cpu"), bfloat16=True)


def _network(seed: int = 0, actions: int = 6, quantiles: int = 5, width: int = 0) -> QNetwork:
    torch.manual_seed(seed)
    return QNetwork(actions, vector_width=width, atoms=quantiles)


def _reference(
    predicted: NDArray[np.float64], targets: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Algorithm 1 and equation 10, by loops: losses ``[batch]``, gradient of their sum."""
    losses, gradient = np.zeros(len(predicted)), np.zeros_like(predicted)
    count = predicted.shape[1]
    for row in range(len(predicted)):
        for i in range(count):
            midpoint = (2 * (i + 1) - 1) / (2 * count)
            for target in targets[row]:
                u = target - predicted[row, i]
                share = abs(midpoint - (1.0 if u < 0 else 0.0)) / targets.shape[1]
                losses[row] += share * (0.5 * u * u if abs(u) <= 1 else abs(u) - 0.5)
                gradient[row, i] -= share * max(-1.0, min(1.0, u))
    return losses, gradient


@pytest.fixture(params=[None, *INSTRUCTION_SETS])
def losses_of(request: pytest.FixtureRequest) -> Losses:
    if request.param is None:
        return quantile_huber
    return partial(native_quantile_huber, request.param)


def test_two_quantiles_by_hand(losses_of: Losses) -> None:
    # Midpoints are 0.25 and 0.75. Pairs u = target - θ, and their losses:
    # θ_0 = 0: u = 0.5 → 0.25 · 0.125; u = -2 → 0.75 · 1.5;  mean (0.03125 + 1.125) / 2
    # θ_1 = 1: u = -0.5 → 0.25 · 0.125; u = -3 → 0.25 · 2.5;  mean (0.03125 + 0.625) / 2
    predicted = tensor([[0.0, 1.0]], requires_grad=True)
    loss = losses_of(predicted, tensor([[0.5, -2.0]]))
    assert loss.tolist() == pytest.approx([0.578125 + 0.328125])
    loss.sum().backward()  # type: ignore[no-untyped-call]
    assert predicted.grad is not None
    # -(0.25 · 0.5 - 0.75 · 1) / 2 and -(-0.25 · 0.5 - 0.25 · 1) / 2
    assert predicted.grad.tolist() == [pytest.approx([0.3125, 0.1875])]


def test_what_is_not_a_number_stays_none(losses_of: Losses) -> None:
    predicted = tensor([[0.0, math.nan], [0.0, 1.0]], requires_grad=True)
    loss = losses_of(predicted, tensor([[0.5, -2.0], [0.5, -2.0]]))
    assert loss.isnan().tolist() == [True, False]
    loss.sum().backward()  # type: ignore[no-untyped-call]
    assert predicted.grad is not None
    assert predicted.grad.isnan().tolist() == [[False, True], [False, False]]


finite = st.floats(-4, 4, width=32)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data(), st.integers(1, 3), st.integers(1, 6), st.integers(1, 6))
def test_loss_and_gradient_are_those_of_the_paper(
    losses_of: Losses, data: st.DataObject, batch: int, count: int, others: int
) -> None:
    def numbers(width: int) -> NDArray[np.float64]:
        rows = st.lists(
            st.lists(finite, min_size=width, max_size=width), min_size=batch, max_size=batch
        )
        return np.array(data.draw(rows), np.float64)

    predicted, targets = numbers(count), numbers(others)
    losses, gradient = _reference(predicted, targets)
    ours = torch.tensor(predicted, dtype=torch.float32, requires_grad=True)
    found = losses_of(ours, torch.tensor(targets, dtype=torch.float32))
    found.sum().backward()  # type: ignore[no-untyped-call]
    assert ours.grad is not None
    np.testing.assert_allclose(found.detach().numpy(), losses, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(ours.grad.numpy(), gradient, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize(("count", "others"), [(51, 51), (16, 3), (17, 32), (256, 1)])
@pytest.mark.parametrize("threads", [1, 2])
def test_loss_and_gradient_of_many_quantiles(
    losses_of: Losses, count: int, others: int, threads: int
) -> None:
    """More than a vector of the processor has, and weights of transitions."""
    rng = np.random.default_rng(count)
    predicted, targets = rng.normal(0, 2, (5, count)), rng.normal(0, 2, (5, others))
    weights = np.array([1, 0.5, 0, 3, 1])
    losses, _ = _reference(predicted, targets)
    ours = torch.tensor(predicted, dtype=torch.float32, requires_grad=True)
    with torch_threads(threads):
        # In another layout than the code reads.
        found = losses_of(ours, torch.tensor(targets.T.copy(), dtype=torch.float32).T)
        (torch.tensor(weights) * found).sum().backward()  # type: ignore[no-untyped-call]
    np.testing.assert_allclose(found.detach().numpy(), losses, rtol=1e-4)
    gradient = np.stack(
        [
            w * _reference(predicted[i : i + 1], targets[i : i + 1])[1][0]
            for i, w in enumerate(weights)
        ]
    )
    assert ours.grad is not None
    np.testing.assert_allclose(ours.grad.numpy(), gradient, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_a_target_that_is_no_number_is_not_hidden(losses_of: Losses, wrong: float) -> None:
    predicted = torch.zeros(2, 3, requires_grad=True)
    found = losses_of(predicted, tensor([[0.0, wrong], [1.0, 1.0]]))
    assert not math.isfinite(float(found[0]))
    assert math.isfinite(float(found[1]))


@pytest.mark.parametrize("instruction_set", INSTRUCTION_SETS)
def test_what_the_compiled_loss_cannot_read_is_refused(instruction_set: InstructionSet) -> None:
    three = torch.zeros(2, 3, requires_grad=True)
    for predicted, targets in (
        (three, torch.zeros(2, 3, dtype=torch.float64)),
        (three.double(), torch.zeros(2, 3)),
        (three, torch.zeros(1, 3)),
        (three, torch.zeros(3)),
        (torch.zeros(2, 3, 1), torch.zeros(2, 3)),
    ):
        with pytest.raises(ValueError, match=r"^not quantiles: torch.float.* \(\d, "):
            native_quantile_huber(instruction_set, predicted, targets)
    losses = native_quantile_huber(instruction_set, three, torch.ones(2, 3))
    weights = torch.ones(2, requires_grad=True)
    (once,) = torch.autograd.grad((weights * losses).sum(), three, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        once.sum().backward()  # type: ignore[no-untyped-call]


def test_the_target_is_of_the_action_that_the_values_choose() -> None:
    quantiles_t = tensor([[[0.0, 2.0], [5.0, 7.0]], [[1.0, 1.0], [-1.0, 9.0]]], requires_grad=True)
    q_t = tensor([[1.0, 0.0], [0.0, 1.0]])  # actions 0 and 1
    targets = target_quantiles(tensor([1.0, -1.0]), tensor([0.5, 0.0]), quantiles_t, q_t)
    assert targets.tolist() == [[1.0, 2.0], [-1.0, -1.0]]
    assert not targets.requires_grad


def test_the_quantiles_of_an_action() -> None:
    quantiles = torch.arange(24.0).reshape(2, 3, 4)
    assert of_action(quantiles, tensor([2, 0])).tolist() == [[8, 9, 10, 11], [12, 13, 14, 15]]


@pytest.mark.parametrize("target", ["dqn", "double"])
@pytest.mark.parametrize("device", [CPU, CPU_BFLOAT16])
def test_an_update_is_the_plain_one(target: str, device: Device) -> None:
    """Which network chooses, whose quantiles count, and what weights and priorities are."""
    config = LearningConfig(target=target, algorithm="qr_dqn")  # type: ignore[arg-type]
    online, other = _network(0, width=9), _network(1, width=9)
    algorithm = qr_dqn(_network(0, width=9), config, device)
    changed = {f"target.{name}": value for name, value in other.state_dict().items()}
    algorithm.load_state(algorithm.state() | changed)
    batch = random_batch(width=9)._replace(weights=torch.linspace(0.1, 1, 8))
    result = learn(algorithm, batch)

    with torch.no_grad():
        best = (online if target == "double" else other)(batch.s_t, batch.x_t).argmax(1)
        theta = of_action(online.atoms(batch.s_tm1, batch.x_tm1), batch.a_tm1)
        theta_t = of_action(other.atoms(batch.s_t, batch.x_t), best)
    targets = batch.r_t[:, None] + batch.discount_t[:, None] * theta_t
    losses, _ = _reference(theta.double().numpy(), targets.double().numpy())
    rough = 0.02 if device.bfloat16 else 1e-4
    assert float(result.loss) == pytest.approx(
        float((losses * batch.weights.numpy()).mean()), rough
    )
    errors = targets.mean(1) - theta.mean(1)
    torch.testing.assert_close(result.priorities, errors.abs(), rtol=rough, atol=rough)
    torch.testing.assert_close(result.td_errors, errors, rtol=rough, atol=rough)
    torch.testing.assert_close(result.targets, targets.mean(1), rtol=rough, atol=rough)


def test_it_learns_the_distribution_of_a_random_reward() -> None:
    """One state, whose end pays 0 three times of four and 1 else: quantiles of a coin."""
    config = replace(PRESETS["fast"].learning, algorithm="qr_dqn", learning_rate=1e-3)
    algorithm = qr_dqn(_network(actions=2, quantiles=4), config, CPU)
    one = random_batch(size=1)
    batch = one._replace(
        s_tm1=one.s_tm1.expand(5, -1, -1, -1),
        s_t=one.s_t.expand(5, -1, -1, -1),
        a_tm1=tensor([0, 0, 0, 0, 1]),
        r_t=tensor([0.0, 0.0, 0.0, 1.0, 0.5]),
        discount_t=torch.zeros(5),
        weights=torch.ones(5),
        x_tm1=torch.zeros(5, 0),
        x_t=torch.zeros(5, 0),
    )
    for _ in range(120):
        learn(algorithm, batch)
    with torch.no_grad():
        coin, sure = algorithm.online.atoms(one.s_tm1, one.x_tm1)[0]
    # Huber's quantile τ of the coin: τ · 1/4 · (1 - θ) = (1 - τ) · 3/4 · θ.
    taus = torch.tensor([1, 3, 5, 7]) / 8
    expected = taus / (taus + 3 * (1 - taus))
    torch.testing.assert_close(coin, expected, rtol=0, atol=0.05)
    torch.testing.assert_close(sure, torch.full((4,), 0.5), rtol=0, atol=0.05)


def test_what_it_learns_is_what_actors_play() -> None:
    config = replace(PRESETS["fast"], learning=LearningConfig(algorithm="qr_dqn", quantiles=7))
    network = build_network(config, 6)
    batch = random_batch()
    with torch.no_grad():
        quantiles = network.atoms(batch.s_t, batch.x_t)
        values = network(batch.s_t, batch.x_t)
    assert quantiles.shape == (8, 6, 7)
    torch.testing.assert_close(values, quantiles.mean(2))
    algorithm = qr_dqn(network, config.learning, CPU)
    torch.testing.assert_close(algorithm.max_q(batch.s_t, batch.x_t), values.amax(1))
