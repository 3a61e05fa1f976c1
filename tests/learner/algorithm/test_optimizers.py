"""The optimizers against their formulas, step by step in plain Python."""

import math

import pytest
import torch

from common.run.config import LearningConfig
from learner.algorithm.optimizers import BoundedOptimizer, build_optimizer, clip_gradients

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
