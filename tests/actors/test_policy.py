"""ε-greedy: the share of random actions, and that the others are the best."""

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from actors.policy import Policy
from common.network import QNetwork

ACTIONS = 6


class Handmade(QNetwork):
    """Values that say themselves which is best: the action in the newest frame's first pixel."""

    def __init__(self) -> None:
        super().__init__(ACTIONS)
        self.asked = 0

    def forward(self, frames: Tensor, vectors: Tensor) -> Tensor:
        assert not self.training
        self.asked += len(frames)
        wanted = frames[:, -1, 0, 0].long() + (vectors[:, 0].long() if vectors.shape[1] else 0)
        return -(torch.arange(ACTIONS) - wanted[:, None]).abs().float()


def policy_of(epsilon: float, envs: int, seed: int = 0) -> Policy:
    policy = Policy(Handmade(), ACTIONS, np.random.default_rng(seed), envs=envs)
    policy.epsilon = epsilon
    return policy


def states(*best: int) -> NDArray[np.uint8]:
    frames = np.zeros((len(best), 4, 84, 84), np.uint8)
    frames[:, -1, 0, 0] = best
    return frames


def no_vectors(count: int) -> NDArray[np.float32]:
    return np.zeros((count, 0), np.float32)


def test_without_chance_it_is_greedy() -> None:
    best = [3, 0, 5, 1, 1, 4]
    assert policy_of(0.0, 6).act(states(*best), no_vectors(6)).tolist() == best


def test_the_vector_reaches_the_network() -> None:
    vectors = np.array([[2.0], [0.0], [3.0]], np.float32)
    assert policy_of(0.0, 3).act(states(1, 1, 1), vectors).tolist() == [3, 1, 4]


def test_by_chance_alone_every_action_is_as_likely_and_the_network_rests() -> None:
    policy = policy_of(1.0, 10)
    counts = np.zeros(ACTIONS)
    for _ in range(600):
        counts += np.bincount(policy.act(states(*[0] * 10), no_vectors(10)), minlength=ACTIONS)
    assert counts.sum() == 6_000
    # χ² of 5 degrees of freedom is below 20.5 with probability 0.999.
    assert ((counts - 1_000) ** 2 / 1_000).sum() < 20.5
    assert isinstance(policy.network, Handmade)
    assert policy.network.asked == 0


@pytest.mark.parametrize("epsilon", [0.05, 0.3, 0.8])
def test_the_share_of_chance_is_epsilon_in_each_environment(epsilon: float) -> None:
    policy = policy_of(epsilon, 3)
    best = [0, 3, 5]
    draws = 2_000
    hits = np.zeros(3)
    for _ in range(draws):
        hits += policy.act(states(*best), no_vectors(3)) == best
    # Chance hits the best action too, once in six.
    expected = 1 - epsilon * (1 - 1 / ACTIONS)
    deviation = np.sqrt(expected * (1 - expected) / draws)
    assert (np.abs(hits / draws - expected) < 4 * deviation).all()


def test_environments_are_random_independently() -> None:
    policy = policy_of(0.5, 2)
    both = [policy.act(states(0, 0), no_vectors(2)).tolist() for _ in range(1_000)]
    # Each is random and not 0 with probability 0.5 × 5/6.
    share = np.mean([one != 0 and other != 0 for one, other in both])
    expected = (0.5 * 5 / 6) ** 2
    assert abs(share - expected) < 4 * np.sqrt(expected * (1 - expected) / 1_000)


def test_the_same_seed_acts_the_same() -> None:
    one, other, third = policy_of(0.5, 2, 1), policy_of(0.5, 2, 1), policy_of(0.5, 2, 2)

    def acted(policy: Policy) -> list[list[int]]:
        return [policy.act(states(0, 1), no_vectors(2)).tolist() for _ in range(50)]

    first = acted(one)
    assert acted(other) == first
    assert acted(third) != first
