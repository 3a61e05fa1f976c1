"""Chance: εz-greedy's law of durations, the share of random agent steps, Ape-X's powers."""

import itertools

import numpy as np
import pytest

from actors.exploration import DURATION_LAW, GREEDY, MEAN_DURATION, Exploration
from common.settings.config import ExplorationConfig


def exploration(envs: int = 1, actions: int = 6, seed: int = 1, **config: bool) -> Exploration:
    return Exploration(ExplorationConfig(**config), actions, envs, np.random.default_rng(seed))


def runs(drawn: list[int]) -> list[tuple[int, int]]:
    """Value and length of each run of equal values."""
    ends = [i for i in range(1, len(drawn)) if drawn[i] != drawn[i - 1]]
    bounds = [0, *ends, len(drawn)]
    return [(drawn[a], b - a) for a, b in itertools.pairwise(bounds)]


def test_the_law_is_three_more_than_zipf_cut_at_twelve() -> None:
    # Drawn from NumPy's own Zipf.
    drawn = np.minimum(3 + np.random.default_rng(0).zipf(2.0, 200_000), 12)
    counts = np.bincount(drawn, minlength=13)[4:]
    expected = DURATION_LAW * len(drawn)
    # χ² of 8 degrees of freedom is below 26.1 with probability 0.999.
    assert ((counts - expected) ** 2 / expected).sum() < 26.1
    assert pytest.approx(drawn.mean(), rel=0.01) == MEAN_DURATION


def test_a_random_action_lasts_by_that_law() -> None:
    # With a thousand actions, two runs next to each other hardly ever have the same.
    chance = exploration(actions=1_000, ez_greedy=True)
    drawn = [int(chance.draw(0.5)[0]) for _ in range(60_000)]
    lengths = [length for action, length in runs(drawn)[1:-1] if action != GREEDY]
    assert min(lengths) == 4
    counts = np.bincount(lengths, minlength=13)[4:13]
    expected = DURATION_LAW * len(lengths)
    assert ((counts - expected) ** 2 / expected).sum() < 26.1


@pytest.mark.parametrize("ez_greedy", [False, True])
@pytest.mark.parametrize("epsilon", [0.0, 0.05, 0.4, 1.0])
def test_the_share_of_random_agent_steps_is_epsilon(epsilon: float, ez_greedy: bool) -> None:
    chance = exploration(envs=8, ez_greedy=ez_greedy)
    drawn = np.array([chance.draw(epsilon) for _ in range(10_000)])
    share = (drawn != GREEDY).mean()
    # Runs of up to 12 make 80,000 agent steps worth some 80,000 / 12 independent ones at least.
    deviation = np.sqrt(epsilon * (1 - epsilon) / (80_000 / (12 if ez_greedy else 1)))
    assert abs(share - epsilon) <= 4 * deviation
    assert set(np.unique(drawn)) <= {GREEDY, *range(6)}


def test_environments_do_not_explore_together() -> None:
    chance = exploration(envs=2, actions=1_000, ez_greedy=True)
    drawn = np.array([chance.draw(0.5) for _ in range(4_000)])
    both = (drawn != GREEDY).all(axis=1)
    assert both.mean() == pytest.approx(0.25, abs=0.05)
    assert (drawn[both, 0] != drawn[both, 1]).mean() > 0.98
