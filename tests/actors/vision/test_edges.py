"""The fine search for a quadrilateral's sides, in pictures drawn column by column."""

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.vision.edges import Outline, refine

ROUGH = np.array([[62, 56], [258, 65], [262, 178], [57, 183]], np.float32)
"""Corners up to five pixels beside those of the rectangle."""
EXACT = np.array([[59.5, 60.5], [259.5, 60.5], [259.5, 180.5], [59.5, 180.5]], np.float32)
"""Its own, between two pixels."""


def picture(tops: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Returns a light picture with a dark rectangle, whose columns begin at the rows ``tops``."""
    grey = np.full((240, 320), 200, np.uint8)
    for column, top in enumerate(tops, start=60):
        grey[top:181, column] = 0
    return grey


def test_each_side_is_moved_onto_its_edge() -> None:
    found = refine(picture(np.full(200, 61)), ROUGH, 50.0)
    assert found is not None
    np.testing.assert_allclose(found, EXACT, atol=0.05)


def test_what_hides_half_of_a_side_does_not_move_it() -> None:
    tops = np.full(200, 61)
    tops[20:110] = 65  # an object that is as light, with an edge of its own
    found = refine(picture(tops), ROUGH, 50.0)
    assert found is not None
    np.testing.assert_allclose(found, EXACT, atol=0.2)


def test_a_side_that_is_no_line_is_not_found() -> None:
    """Steps of one place each: no line has more than a third of them."""
    steps = 56 + 5 * ((np.arange(200) - 4) // 8 % 3)
    assert refine(picture(steps), EXACT, 50.0) is None


def test_a_side_whose_light_falls_too_little_is_not_found() -> None:
    grey = picture(np.full(200, 61))
    assert refine(grey // 4, ROUGH, 55.0) is None
    assert refine(grey // 4, ROUGH, 45.0) is not None


@pytest.mark.parametrize("moved", [-2, 0, 2])
def test_a_side_that_moved_inward_or_outward_is_not_in_place(moved: int) -> None:
    shares = Outline(EXACT).in_place(picture(np.full(200, 61 + moved)), 50.0)
    assert shares[0] == (moved == 0)
    assert shares[2] == 1
