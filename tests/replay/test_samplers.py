import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from replay.samplers import PrioritisedSampler, UniformSampler
from replay.sum_tree import padded

CAPACITY = 50
NONE = np.zeros(0, np.int64)


def prioritised(alpha: float = 1.0, beta: float = 1.0) -> PrioritisedSampler:
    return PrioritisedSampler(CAPACITY, NONE, np.zeros(padded(CAPACITY)), alpha, beta)


@settings(max_examples=50)
@given(st.lists(st.tuples(st.booleans(), st.sets(st.integers(0, 19), max_size=8)), max_size=30))
def test_admitted_ids_are_a_set(changes: list[tuple[bool, set[int]]]) -> None:
    sampleable, expected = UniformSampler(20, NONE), set[int]()
    turn = 1_000  # ids are far beyond their slots
    for add, slots in changes:
        ids = {turn * 20 + slot for slot in slots}
        ids = ids - expected if add else ids & expected
        (sampleable.add if add else sampleable.remove)(np.array(sorted(ids), np.int64))
        expected = expected | ids if add else expected - ids
        assert set(sampleable.ids.tolist()) == expected
        assert len(sampleable) == len(expected)
        everything = np.arange((turn - 1) * 20, (turn + 2) * 20)
        assert set(everything[sampleable.contains(everything)].tolist()) == expected


def test_uniform_draws_each_step_as_often() -> None:
    sampler = UniformSampler(CAPACITY, np.arange(100, 120))
    sampler.add(np.arange(120, 140))
    sampler.remove(np.array([100, 105, 139]))
    ids, weights = sampler.draw(np.random.default_rng(0), 37_000)
    counts = np.bincount(ids, minlength=140)
    assert counts[[100, 105, 139]].tolist() == [0, 0, 0]
    # 1,000 expected each, standard deviation 31
    assert np.abs(counts[counts > 0] - 1_000).max() < 160
    assert np.count_nonzero(counts) == 37
    assert (weights == 1).all()


def test_prioritised_draws_in_proportion_to_the_power_of_the_priority() -> None:
    sampler = prioritised(alpha=0.5)
    ids = np.arange(200, 204)
    sampler.add(ids)
    sampler.update(ids, np.array([1.0, 4.0, 9.0, 16.0]))
    drawn, weights = sampler.draw(np.random.default_rng(0), 50_000)
    shares = np.bincount(drawn - 200, minlength=4) / 50_000
    np.testing.assert_allclose(shares, [0.1, 0.2, 0.3, 0.4], atol=0.01)
    # (N P)^-1, over the largest: P is 0.1, 0.2, 0.3, 0.4
    expected = np.array([1, 1 / 2, 1 / 3, 1 / 4])[drawn - 200]
    np.testing.assert_allclose(weights, expected, rtol=1e-5)


def test_new_steps_get_the_largest_priority_so_far() -> None:
    sampler = prioritised()
    sampler.add(np.array([0, 1]))
    sampler.update(np.array([0]), np.array([3.0]))
    sampler.add(np.array([2]))
    drawn, _ = sampler.draw(np.random.default_rng(0), 70_000)
    np.testing.assert_allclose(np.bincount(drawn) / 70_000, [3 / 7, 1 / 7, 3 / 7], atol=0.01)


def test_updates_of_steps_that_are_gone_change_nothing() -> None:
    sampler = prioritised()
    sampler.add(np.array([3, 4]))
    sampler.remove(np.array([3]))
    sampler.add(np.array([3 + CAPACITY]))  # the same slot
    sampler.update(np.array([3, 3 + 2 * CAPACITY]), np.array([1e9, 1e9]))
    drawn, weights = sampler.draw(np.random.default_rng(0), 10_000)
    assert set(drawn.tolist()) == {4, 3 + CAPACITY}
    assert (weights == 1).all()


def test_a_priority_of_zero_can_still_be_drawn() -> None:
    sampler = prioritised()
    sampler.add(np.array([8]))
    sampler.update(np.array([8]), np.array([0.0]))
    assert sampler.draw(np.random.default_rng(0), 3)[0].tolist() == [8, 8, 8]


def test_a_new_step_has_the_largest_priority_that_there_ever_was() -> None:
    sampler = prioritised()
    sampler.add(np.array([3, 4]))
    sampler.update(np.array([3]), np.array([6.0]))
    sampler.update(np.array([3, 4]), np.array([3.0, 3.0]))
    sampler.add(np.array([5]))
    drawn, _ = sampler.draw(np.random.default_rng(0), 40_000)
    assert np.bincount(drawn)[3:] / 40_000 == pytest.approx([0.25, 0.25, 0.5], abs=0.01)


def test_priorities_survive_in_their_leaves() -> None:
    leaves = np.zeros(padded(CAPACITY))
    first = PrioritisedSampler(CAPACITY, NONE, leaves, 1.0, 0.5)
    first.add(np.array([10, 11, 12]))
    first.update(np.array([10, 11]), np.array([2.0, 6.0]))
    second = PrioritisedSampler(CAPACITY, np.array([10, 11]), leaves, 1.0, 0.5)  # 12 is gone
    drawn, _ = second.draw(np.random.default_rng(0), 40_000)
    assert np.bincount(drawn)[10:] / 40_000 == pytest.approx([0.25, 0.75], abs=0.01)


@pytest.mark.parametrize("found", [0.0, -1.0, np.nan, np.inf, 1e308])
def test_leaves_that_no_priority_can_be_count_as_the_largest(found: float) -> None:
    """The disk has changed them; two of 1e308 have a sum that is infinite."""
    leaves = np.zeros(padded(CAPACITY))
    leaves[10:15] = [1.0, 2.0, 1.0, found, found]
    sampler = PrioritisedSampler(CAPACITY, np.arange(10, 15), leaves, 1.0, 0.5)
    drawn, weights = sampler.draw(np.random.default_rng(0), 40_000)
    shares = np.bincount(drawn)[10:] / 40_000
    assert shares == pytest.approx([1 / 8, 1 / 4, 1 / 8, 1 / 4, 1 / 4], abs=0.01)
    assert np.isfinite(weights).all()
