"""Turns and slices: what is compared works side by side, and warm-up does not count."""

from functools import partial

from benchmarks.pace import Spread, in_turns, per_second, slice_per_second


def test_contenders_take_turns_and_the_first_does_not_count() -> None:
    order: list[str] = []

    def work(name: str) -> str:
        order.append(name)
        return f"{name}{len(order)}"

    found = in_turns({name: partial(work, name) for name in "ab"}, 2)
    assert order == list("ababab")
    assert found == {"a": ["a3", "a5"], "b": ["b4", "b6"]}


def test_every_turn_counts_without_a_warm_up() -> None:
    counts = iter(range(5))
    assert in_turns({"only": lambda: next(counts)}, 3, warm_up=0) == {"only": [0, 1, 2]}
    assert in_turns({"only": lambda: next(counts)}, 0) == {"only": []}
    assert next(counts) == 4


def test_a_spread_is_the_median_between_least_and_most() -> None:
    found = Spread.of([5.0, 1.0, 4.0, 2.0])
    assert found == (3.0, 1.0, 5.0)
    assert found.cells() == {"per second": 3.0, "least": 1.0, "most": 5.0}


def test_a_slice_has_at_least_one_call() -> None:
    calls: list[int] = []
    assert slice_per_second(lambda: calls.append(1), 0.0) > 0
    assert calls == [1]
    assert per_second(lambda: calls.append(1), 0.0) > 0
    assert calls == [1] * 6
