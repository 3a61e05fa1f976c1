import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from replay import sum_tree
from replay.sum_tree import FANOUT, SumTree, padded


@pytest.fixture(params=[32, 8_192], ids=["deep", "flat"], autouse=True)
def widest(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Small trees, as deep as large ones are, and as flat as small ones are."""
    monkeypatch.setattr(sum_tree, "_WIDEST", request.param)


def naive_find(values: list[float], target: float) -> int:
    running = 0.0
    for slot, value in enumerate(values):
        running += value
        if target < running:
            return slot
    return max(slot for slot, value in enumerate(values) if value > 0)


@pytest.mark.parametrize(("capacity", "size"), [(1, 32), (32, 32), (33, 64), (1025, 1056)])
def test_leaves_fill_whole_nodes(capacity: int, size: int) -> None:
    assert padded(capacity) == size
    assert size % FANOUT == 0


# The fixture is the same for all examples.
@settings(
    max_examples=50,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
@given(
    capacity=st.sampled_from([1, 31, 32, 33, 1_024, 1_025, 3_000]),
    changes=st.lists(st.tuples(st.integers(0, 2_999), st.integers(0, 9)), min_size=1, max_size=60),
    shares=st.lists(st.floats(0, 1, exclude_max=True), min_size=1, max_size=20),
)
def test_it_finds_what_a_search_through_a_list_finds(
    capacity: int, changes: list[tuple[int, int]], shares: list[float]
) -> None:
    values = [0.0] * capacity
    tree = SumTree(np.zeros(padded(capacity)))
    for at in range(0, len(changes), 7):  # several at once, the same slot perhaps twice
        some = [(slot % capacity, float(value)) for slot, value in changes[at : at + 7]]
        for slot, value in some:
            values[slot] = value
        tree.set(np.array([slot for slot, _ in some]), np.array([value for _, value in some]))
    assert tree.total == sum(values)
    assert tree.get(np.arange(capacity)).tolist() == values
    if sum(values):
        targets = np.array(shares) * tree.total
        expected = [naive_find(values, target) for target in targets]
        assert tree.find(targets).tolist() == expected


def test_a_target_pushed_past_the_end_by_rounding_finds_the_last_value() -> None:
    leaves = np.zeros(padded(2_000))
    tree = SumTree(leaves)
    tree.set(np.array([3, 40, 1_500]), np.array([0.1, 0.2, 0.3]))
    assert tree.find(np.array([tree.total, np.nextafter(tree.total, 9)])).tolist() == [1_500] * 2


def test_slots_without_a_value_are_never_found() -> None:
    rng = np.random.default_rng(0)
    values = rng.random(5_000) * (rng.random(5_000) < 0.1)
    tree = SumTree(np.zeros(padded(5_000)))
    tree.set(np.arange(5_000), values)
    found = tree.find(rng.random(20_000) * tree.total)
    assert (values[found] > 0).all()
    # Where one node ends and the next begins, rounding could go either way.
    for row in tree._rows[1:]:
        borders = np.concatenate([[0.0], np.cumsum(row)[:-1]])
        borders = np.concatenate([borders, np.nextafter(borders, 1e9)])
        found = tree.find(borders[borders < tree.total])
        assert (values[found] > 0).all()


def test_slots_are_found_as_often_as_their_values_say() -> None:
    tree = SumTree(np.zeros(padded(4_000)))
    slots = np.array([0, 31, 32, 1_023, 1_024, 3_999])
    tree.set(slots, np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]))
    targets = (np.arange(2_100) + 0.5) / 100  # a hundred to each unit
    found, counts = np.unique(tree.find(targets), return_counts=True)
    assert found.tolist() == slots.tolist()
    assert counts.tolist() == [100, 200, 300, 400, 500, 600]


def test_leaves_of_an_earlier_tree_are_summed() -> None:
    leaves = np.zeros(padded(100))
    leaves[[5, 99]] = [1.0, 3.0]
    tree = SumTree(leaves)
    assert tree.total == 4.0
    assert tree.find(np.array([0.5, 1.5, 3.9])).tolist() == [5, 99, 99]


def test_a_node_whose_children_come_to_less_by_rounding_finds_one_with_a_value() -> None:
    """Added up one by one, they are not quite what they are in pairs."""
    rng, less = np.random.default_rng(0), 0
    for _ in range(200):
        values = rng.random(FANOUT)
        values[0] = 0.0  # where a search that found nothing would end
        tree = SumTree(values.copy())
        less += bool(values.cumsum()[-1] < tree.total)
        (found,) = tree.find(np.array([np.nextafter(tree.total, 0.0)]))
        assert values[found] > 0
    assert less > 20
