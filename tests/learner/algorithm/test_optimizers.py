"""The optimizers against their formulas, step by step in plain Python."""

import math
from dataclasses import replace
from itertools import product

import pytest
import torch
from torch import Tensor, nn

from common.native.library import InstructionSet
from common.settings.config import LearningConfig
from learner.algorithm.optimizers import BoundedOptimizer, build_optimizer, clip_gradients
from tests.native import INSTRUCTION_SETS, torch_threads

LOSS = torch.tensor(1.0)
ADAM = LearningConfig(optimizer="adam", learning_rate=0.01, optimizer_epsilon=1.5e-4)
RMSPROP = LearningConfig(
    optimizer="rmsprop", learning_rate=0.01, rmsprop_decay=0.9, optimizer_epsilon=0.01
)
GRADIENTS = [0.3, -1.2, 0.05, 2.0, 0.0, -0.7]


def _steps(config: LearningConfig) -> list[float]:
    weight = torch.nn.Parameter(torch.tensor([0.5]))
    optimizer = build_optimizer([weight], config)
    found = []
    for gradient in GRADIENTS:
        weight.grad = torch.tensor([gradient])
        optimizer.step()
        found.append(float(weight.detach()))
    return found


def test_rmsprop_is_the_one_of_keras() -> None:
    config = LearningConfig(
        optimizer="rmsprop", learning_rate=0.01, rmsprop_decay=0.9, optimizer_epsilon=0.01
    )
    weight, mean_square, expected = 0.5, 0.0, []
    for gradient in GRADIENTS:
        mean_square = 0.9 * mean_square + 0.1 * gradient**2
        weight -= 0.01 * gradient / (math.sqrt(mean_square) + 0.01)
        expected.append(weight)
    assert _steps(config) == pytest.approx(expected, rel=1e-5)


def test_rmsprop_is_the_one_of_pytorch() -> None:
    config = LearningConfig(
        optimizer="rmsprop", learning_rate=2.5e-4, rmsprop_decay=0.95, optimizer_epsilon=0.01
    )
    generator = torch.Generator().manual_seed(1)
    ours = torch.nn.Parameter(torch.randn(20, 30, generator=generator))
    theirs = torch.nn.Parameter(ours.detach().clone())
    optimizers = (
        build_optimizer([ours], config),
        torch.optim.RMSprop([theirs], lr=2.5e-4, alpha=0.95, eps=0.01),
    )
    for _ in range(150):
        gradient = torch.randn(20, 30, generator=generator)
        for weight, optimizer in zip((ours, theirs), optimizers, strict=True):
            weight.grad = gradient.clone()
            optimizer.step()
    torch.testing.assert_close(ours, theirs, rtol=1e-5, atol=1e-6)


def test_adam_is_the_one_of_its_paper() -> None:
    config = LearningConfig(optimizer="adam", learning_rate=0.01, optimizer_epsilon=1.5e-4)
    weight, first, second, expected = 0.5, 0.0, 0.0, []
    for step, gradient in enumerate(GRADIENTS, start=1):
        first = 0.9 * first + 0.1 * gradient
        second = 0.999 * second + 0.001 * gradient**2
        weight -= (
            0.01 * (first / (1 - 0.9**step)) / (math.sqrt(second / (1 - 0.999**step)) + 1.5e-4)
        )
        expected.append(weight)
    assert _steps(config) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("longest", "factor"), [(20.0, 1.0), (6.5, 0.5), (1.3, 0.1)])
def test_gradients_are_scaled_only_when_together_they_are_too_long(
    longest: float, factor: float
) -> None:
    gradients = [[3.0, 4.0], [12.0]]  # together 13 long: 3² + 4² + 12²
    weights = [torch.nn.Parameter(torch.zeros(len(each))) for each in gradients]
    for weight, gradient in zip(weights, gradients, strict=True):
        weight.grad = torch.tensor(gradient)
    clip_gradients(weights, longest)
    for weight, gradient in zip(weights, gradients, strict=True):
        assert weight.grad is not None
        assert weight.grad.tolist() == pytest.approx([g * factor for g in gradient], rel=1e-5)


def test_what_is_restored_lies_in_memory_as_its_weights_do() -> None:
    """A checkpoint has plain strides, with which the fused kernel would be slow."""
    weight = torch.nn.Parameter(torch.randn(8, 4, 3, 3).to(memory_format=torch.channels_last))
    weight.grad = torch.randn_like(weight)
    one, other = (BoundedOptimizer([weight], LearningConfig()) for _ in range(2))
    one.step(torch.tensor(1.0))
    saved = {name: value.contiguous() for name, value in one.state().items()}
    other.load_state(saved)
    for name, value in other.state().items():
        assert torch.equal(value, saved[name])
        assert value.ndim == 0 or value.stride() == weight.stride()


@pytest.fixture(params=INSTRUCTION_SETS)
def native(request: pytest.FixtureRequest) -> InstructionSet:
    chosen: InstructionSet = request.param
    return chosen


def weights_of_many_shapes() -> list[nn.Parameter]:
    """A single number, a small matrix, one that needs several blocks, and a channels-last one."""
    generator = torch.Generator().manual_seed(1)
    sizes = [(1,), (7, 5), (3, 16_385), (8, 4, 3, 3)]
    weights = [torch.randn(*size, generator=generator) for size in sizes]
    weights[-1] = weights[-1].to(memory_format=torch.channels_last)
    return [nn.Parameter(each) for each in weights]


def take_step(
    optimizer: BoundedOptimizer, weights: list[nn.Parameter], seed: int, loss: Tensor = LOSS
) -> None:
    generator = torch.Generator().manual_seed(seed)
    for weight in weights:
        size = 10.0 ** (seed % 4 - 2)  # together both above and below the bound
        drawn = size * torch.randn(weight.shape, generator=generator)
        weight.grad = torch.empty_like(weight).copy_(drawn).detach()
    optimizer.step(loss)


def assert_same_slots(ours: BoundedOptimizer, theirs: BoundedOptimizer, but: str = "-") -> None:
    """Compares what two optimizers keep, without the slots whose names end with ``but``."""
    kept = theirs.state()
    for name, value in ours.state().items():
        if not name.endswith(but):
            torch.testing.assert_close(value, kept[name], rtol=1e-5, atol=1e-6)


@pytest.fixture
def only_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """PyTorch's own step, which would hide that the compiled one is not taken, is refused."""
    whole = BoundedOptimizer.step

    def step(self: BoundedOptimizer, loss: Tensor) -> None:
        if self._library is not None:
            monkeypatch.setattr(self._optimizer, "step", None)
        whole(self, loss)

    monkeypatch.setattr(BoundedOptimizer, "step", step)


@pytest.mark.usefixtures("only_compiled")
@pytest.mark.parametrize(
    ("config", "bound", "threads"), list(product((ADAM, RMSPROP), (0.0, 1.0, 300.0), (1, 2)))
)
def test_the_compiled_step_is_pytorchs(
    config: LearningConfig, bound: float, threads: int, native: InstructionSet
) -> None:
    config = replace(config, gradient_norm=bound)
    ours, theirs = weights_of_many_shapes(), weights_of_many_shapes()
    before = [weight.detach().clone() for weight in ours]
    compiled, plain = BoundedOptimizer(ours, config, native), BoundedOptimizer(theirs, config)
    with torch_threads(threads):
        for seed in range(20):
            take_step(compiled, ours, seed)
            take_step(plain, theirs, seed)
    for our, their, first in zip(ours, theirs, before, strict=True):
        assert not torch.equal(our, first)
        torch.testing.assert_close(our, their, rtol=2e-5, atol=2e-6)
    # The means of RMSprop are the gradients themselves, and are not needed.
    assert_same_slots(compiled, plain, but="-" if config.optimizer == "adam" else "exp_avg")


@pytest.mark.usefixtures("only_compiled")
def test_short_gradients_are_scaled_as_by_pytorch(native: InstructionSet) -> None:
    means = []
    for kind in (native, None):
        weight = nn.Parameter(torch.zeros(64))
        optimizer = BoundedOptimizer([weight], replace(ADAM, gradient_norm=1e-6), kind)
        weight.grad = torch.full_like(weight, 2e-6 / 8)  # a norm of 2e-6
        optimizer.step(torch.tensor(1.0))
        means.append(optimizer.state()["optimizer.0.exp_avg"])
    torch.testing.assert_close(*means, rtol=1e-4, atol=0.0)


@pytest.mark.usefixtures("only_compiled")
@pytest.mark.parametrize("config", [ADAM, RMSPROP])
def test_the_compiled_step_is_that_of_the_formula(
    config: LearningConfig, native: InstructionSet
) -> None:
    weight = nn.Parameter(torch.tensor([0.5]))
    optimizer = BoundedOptimizer([weight], replace(config, gradient_norm=0.0), native)
    found = []
    for gradient in GRADIENTS:
        weight.grad = torch.tensor([gradient])
        optimizer.step(LOSS)
        found.append(float(weight.detach()))
    assert found == pytest.approx(_steps(config), rel=1e-5)


@pytest.mark.usefixtures("only_compiled")
@pytest.mark.parametrize("config", [ADAM, RMSPROP])
def test_either_goes_on_from_what_the_other_kept(
    config: LearningConfig, native: InstructionSet
) -> None:
    weights, expected = weights_of_many_shapes(), weights_of_many_shapes()
    whole = BoundedOptimizer(expected, config)
    state: dict[str, Tensor] = {}
    for seed, kind in enumerate((None, native, None, native)):
        optimizer = BoundedOptimizer(weights, config, kind)
        if state:
            optimizer.load_state(state)
        take_step(optimizer, weights, seed)
        take_step(whole, expected, seed)
        state = {name: value.contiguous() for name, value in optimizer.state().items()}
    for one, other in zip(weights, expected, strict=True):
        torch.testing.assert_close(one, other, rtol=2e-5, atol=2e-6)


@pytest.mark.usefixtures("only_compiled")
@pytest.mark.parametrize("loss", [math.nan, math.inf, -math.inf])
def test_a_loss_that_is_not_finite_moves_nothing(loss: float, native: InstructionSet) -> None:
    for kind in (native, None):
        weights = weights_of_many_shapes()
        optimizer = BoundedOptimizer(weights, ADAM, kind)
        take_step(optimizer, weights, 0)
        before = [weight.detach().clone() for weight in weights]
        kept = {name: value.clone() for name, value in optimizer.state().items()}
        take_step(optimizer, weights, 1, torch.tensor(loss))
        for weight, value in zip(weights, before, strict=True):
            assert torch.equal(weight, value)
        for name, value in optimizer.state().items():
            assert torch.equal(value, kept[name])


@pytest.mark.parametrize("lasts", [3, 2])
def test_a_gradient_that_is_missing_leaves_its_parameter(
    lasts: int, native: InstructionSet
) -> None:
    """And when it comes, its parameter has taken fewer steps than the others, which counts."""
    found = []
    for kind in (native, None):
        weights = weights_of_many_shapes()
        optimizer = BoundedOptimizer(weights, ADAM, kind)
        for seed in range(3):
            for weight in weights:
                weight.grad = torch.full_like(weight, 0.1 + seed)
            if seed < lasts:
                weights[1].grad = None
            optimizer.step(LOSS)
        found.append(weights)
    for ours, theirs in zip(*found, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-5, atol=1e-6)


def test_a_parameter_that_was_behind_in_a_checkpoint_stays_behind(native: InstructionSet) -> None:
    found = []
    for kind in (native, None):
        weights = weights_of_many_shapes()
        optimizer = BoundedOptimizer(weights, ADAM, kind)
        for seed in range(3):
            before, optimizer = optimizer, BoundedOptimizer(weights, ADAM, kind)
            optimizer.load_state(before.state())
            for weight in weights:
                weight.grad = torch.full_like(weight, 0.1 + seed)
            if seed == 0:
                weights[1].grad = None
            optimizer.step(LOSS)
        found.append(weights)
    for ours, theirs in zip(*found, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-5, atol=1e-6)


@pytest.mark.usefixtures("only_compiled")
def test_after_a_restore_it_goes_on_from_what_was_restored(native: InstructionSet) -> None:
    ours, theirs = weights_of_many_shapes(), weights_of_many_shapes()
    compiled, plain = BoundedOptimizer(ours, ADAM, native), BoundedOptimizer(theirs, ADAM)
    take_step(compiled, ours, 0)
    for seed in (0, 1):
        take_step(plain, theirs, seed)
    with torch.no_grad():
        for our, their in zip(ours, theirs, strict=True):
            our.copy_(their)
    compiled.load_state(plain.state())
    take_step(compiled, ours, 2)
    take_step(plain, theirs, 2)
    for our, their in zip(ours, theirs, strict=True):
        torch.testing.assert_close(our, their, rtol=1e-5, atol=1e-6)
    assert_same_slots(compiled, plain)


@pytest.mark.usefixtures("only_compiled")
@pytest.mark.parametrize("config", [ADAM, RMSPROP])
def test_gradients_whose_squares_are_infinite_leave_finite_weights(
    config: LearningConfig, native: InstructionSet
) -> None:
    weight = nn.Parameter(torch.ones(40))
    optimizer = BoundedOptimizer([weight], replace(config, gradient_norm=0.0), native)
    for _ in range(3):
        weight.grad = torch.full((40,), 1e25)
        optimizer.step(LOSS)
    assert weight.isfinite().all()  # as by PyTorch's


@pytest.mark.parametrize("kind", [None, "native"])
@pytest.mark.parametrize(
    "gradient", [torch.arange(35.0).reshape(5, 7).t() / 35, torch.tensor(2.0).expand(7, 5)]
)
def test_a_gradient_may_lie_in_memory_in_another_way(
    gradient: Tensor, kind: str | None, native: InstructionSet
) -> None:
    weight = nn.Parameter(torch.zeros(7, 5))
    optimizer = BoundedOptimizer([weight], ADAM, native if kind else None)
    weight.grad = gradient
    optimizer.step(LOSS)
    assert weight.grad is not None
    scale = min(ADAM.gradient_norm / float(gradient.norm()), 1.0) if ADAM.gradient_norm else 1.0
    mean = optimizer.state()["optimizer.0.exp_avg"]
    torch.testing.assert_close(mean, 0.1 * scale * gradient, rtol=1e-4, atol=1e-7)


def test_parameters_of_another_type_are_pytorchs(native: InstructionSet) -> None:
    weight = nn.Parameter(torch.zeros(3, dtype=torch.float64))
    optimizer = BoundedOptimizer([weight], replace(ADAM, gradient_norm=0.0), native)
    weight.grad = torch.ones(3, dtype=torch.float64)
    optimizer.step(LOSS)
    assert weight.tolist() == pytest.approx([-0.01] * 3, rel=1e-3)


@pytest.mark.usefixtures("only_compiled")
def test_the_compiled_step_has_the_rate_of_the_moment(native: InstructionSet) -> None:
    config = replace(ADAM, annealing_steps=400, final_learning_rate=0.001, train_period=4)
    moved = []
    for updates in (0, 50, 1_000):
        weight = nn.Parameter(torch.zeros(1))
        optimizer = BoundedOptimizer([weight], config, native)
        optimizer.set_rate(updates)
        weight.grad = torch.ones(1)
        optimizer.step(LOSS)
        moved.append(-float(weight.detach()))
    assert moved == pytest.approx([0.01, 0.0055, 0.001], rel=1e-3)


@pytest.mark.parametrize("steps", [-1.0, -1e6, math.nan, math.inf])
def test_a_number_of_steps_that_cannot_be_is_refused(steps: float) -> None:
    weights = weights_of_many_shapes()
    optimizer = BoundedOptimizer(weights, ADAM)
    take_step(optimizer, weights, 0)
    wrong = optimizer.state() | {"optimizer.2.step": torch.tensor(steps)}
    with pytest.raises(ValueError, match=r"its optimizer\.2\.step is "):
        optimizer.load_state(wrong)


def test_slots_of_other_parameters_are_refused() -> None:
    """The compiled step would read and write beyond them."""
    weights = weights_of_many_shapes()
    optimizer = BoundedOptimizer(weights, ADAM)
    take_step(optimizer, weights, 0)
    state = optimizer.state()
    for name, wrong in (
        ("optimizer.1.exp_avg", torch.zeros(5, 7)),
        ("optimizer.1.exp_avg_sq", torch.zeros(())),
        ("optimizer.3.step", torch.zeros(2)),
    ):
        with pytest.raises(ValueError, match=f"its {name} is missing, or of another shape"):
            optimizer.load_state(state | {name: wrong})
        with pytest.raises(ValueError, match=r"its optimizer\.4\.exp_avg is of no parameter"):
            optimizer.load_state(state | {"optimizer.4.exp_avg": torch.zeros(1)})
        lacking = {key: value for key, value in state.items() if key != name}
        with pytest.raises(ValueError, match=f"its {name} is missing"):
            optimizer.load_state(lacking)
