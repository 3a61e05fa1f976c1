"""The fine search for a quadrilateral's sides, in pictures drawn column by column."""

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.vision.edges import refine

ROUGH = np.array([[62, 58], [258, 63], [262, 178], [57, 183]], np.float32)
"""Corners a few pixels beside those of the rectangle."""


def picture(tops: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Returns a light picture with a dark rectangle, whose columns begin at the rows ``tops``."""
    grey = np.full((240, 320), 200, np.uint8)
    for column, top in enumerate(tops, start=60):
        grey[top:181, column] = 0
    return grey


def test_each_side_is_moved_onto_its_edge() -> None:
    found = refine(picture(np.full(200, 61)), ROUGH, 50.0)
    assert found is not None
    exact = [[59.5, 60.5], [259.5, 60.5], [259.5, 180.5], [59.5, 180.5]]  # between two pixels
    np.testing.assert_allclose(found, exact, atol=0.05)


def test_what_hides_half_of_a_side_does_not_move_it() -> None:
    tops = np.full(200, 61)
    tops[20:110] = 65  # an object that is as light, with an edge of its own
    found = refine(picture(tops), ROUGH, 50.0)
    assert found is not None
    np.testing.assert_allclose(found[:2], [[59.5, 60.5], [259.5, 60.5]], atol=0.2)


@pytest.mark.parametrize("seed", range(3))
def test_a_side_that_is_no_line_is_not_found(seed: int) -> None:
    ragged = np.random.default_rng(seed).permutation(np.arange(200) % 12) + 55
    assert refine(picture(ragged), ROUGH, 50.0) is None


def test_a_side_whose_light_falls_too_little_is_not_found() -> None:
    grey = picture(np.full(200, 61))
    assert refine(grey // 4, ROUGH, 55.0) is None
    assert refine(grey // 4, ROUGH, 45.0) is not None
