"""Bars of Q-values, by hand."""

import numpy as np

from common.q_bars import q_bars


def test_the_best_are_shown_in_the_order_of_the_actions() -> None:
    values = np.array([0.5, -1.0, 1.0, 0.0], np.float32)
    assert list(q_bars(values, 4, 8)) == [
        (0, "   0.500", "█" * 6),
        (1, "  −1.000", ""),
        (2, "   1.000", "█" * 8),
        (3, "   0.000", "█" * 4),
    ]
    assert [index for index, _, _ in q_bars(values, 2, 8)] == [0, 2]


def test_of_equal_values_the_first_actions_are_shown_without_bars() -> None:
    assert list(q_bars(np.zeros(3), 2, 8)) == [(0, "   0.000", ""), (1, "   0.000", "")]
