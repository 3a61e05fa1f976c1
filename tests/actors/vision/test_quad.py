"""The rough search, in dark regions that are drawn pixel by pixel."""

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.vision.quad import dark_quads, meet

Corners = Sequence[tuple[float, float]]
SCREEN = [(60, 40), (250, 55), (240, 190), (70, 180)]
"""Clockwise from the top left."""
ROWS, COLUMNS = np.mgrid[:240, :320]


def inside(corners: Corners) -> NDArray[np.bool_]:
    """Returns the pixels to the right of every side of a convex shape, clockwise in the picture."""
    within = np.ones(ROWS.shape, bool)
    for (x, y), (next_x, next_y) in zip(corners, [*corners[1:], corners[0]], strict=True):
        within &= (next_x - x) * (ROWS - y) >= (next_y - y) * (COLUMNS - x)
    return within


def box(left: int, top: int, right: int, bottom: int, slope: float = 0.0) -> NDArray[np.bool_]:
    return inside(tilted([(left, top), (right, top), (right, bottom), (left, bottom)], slope))


def tilted(corners: Corners, slope: float) -> Corners:
    return [(x, y + slope * (x - 60)) for x, y in corners]


def quads(dark: NDArray[np.bool_]) -> list[NDArray[np.float32]]:
    return list(dark_quads(np.where(dark, 255, 0).astype(np.uint8)))


def error(quad: NDArray[np.float32], corners: Corners) -> float:
    """Returns the distance of the worst corner, pixels."""
    return float(np.linalg.norm(quad - np.array(corners), axis=1).max())


def test_corners_are_given_clockwise_from_the_top_left() -> None:
    (quad,) = quads(inside(SCREEN))
    assert quad.dtype == np.float32
    assert error(quad, SCREEN) < 1.5


def test_the_two_largest_regions_are_searched_the_largest_first() -> None:
    large, middle, small = box(10, 10, 160, 120), box(180, 20, 280, 100), box(20, 150, 100, 210)
    tall = box(300, 10, 305, 230)  # higher than all, but it covers the least
    found = quads(large | middle | small | tall)
    assert [
        error(quad, corners) < 1.5
        for quad, corners in zip(
            found,
            (
                [(10, 10), (160, 10), (160, 120), (10, 120)],
                [(180, 20), (280, 20), (280, 100), (180, 100)],
            ),
            strict=True,
        )
    ] == [True, True]


@pytest.mark.parametrize(("right", "bottom", "found"), [(149, 135, True), (138, 126, False)])
def test_a_fiftieth_of_the_picture_is_the_least(right: int, bottom: int, found: bool) -> None:
    """1,536 pixels: 50 × 36 are more, and 39 × 27 are fewer, even with a cable from it that makes
    its box larger."""
    assert bool(quads(box(100, 100, right, bottom))) == found
    assert bool(quads(box(100, 100, right, bottom) | box(100, 110, 250, 112))) == found


@pytest.mark.parametrize(
    ("width", "height", "found"),
    [(120, 200, False), (160, 200, True), (230, 100, True), (260, 100, False)],
)
def test_the_ratio_of_width_to_height_is_bounded(width: int, height: int, found: bool) -> None:
    assert bool(quads(box(20, 20, 20 + width, 20 + height))) == found


def test_the_ratio_is_that_of_the_middle() -> None:
    """A width of 210, 2.4 times the height; the upper side alone has 2.7 times."""
    assert quads(inside([(20, 20), (260, 20), (230, 108), (50, 108)]))


def test_the_light_between_two_dark_things_is_no_quadrilateral() -> None:
    found = quads(
        box(20, 20, 120, 90)
        | inside([(110, 80), (122, 80), (210, 160), (198, 160)])
        | box(200, 150, 300, 220)
    )
    assert found
    for quad in found:
        (right, _), (_, down) = quad[1] - quad[0], quad[3] - quad[0]
        assert right > 0
        assert down > 0


@pytest.mark.parametrize(("beyond", "found"), [(15, True), (60, False)])
def test_a_corner_may_lie_a_little_outside_the_picture(beyond: int, found: bool) -> None:
    corners = [(40, 40), (220, 40), (220, 200), (-beyond, 200)]
    assert any(error(quad, corners) < 2.5 for quad in quads(inside(corners))) == found


@pytest.mark.parametrize("slope", [0.0, 0.07, -0.04])
def test_pieces_of_one_side_count_together(slope: float) -> None:
    """Fingers cut the upper side into pieces, none of which is as long as the side of a dark thing
    that stands on it."""
    dark = box(60, 50, 260, 200, slope) | box(165, 40, 250, 70, slope)
    for x in (82, 108, 134):
        dark &= ~box(x, 20, x + 5, 80)
    quad, *_ = quads(dark)
    assert error(quad, tilted([(60, 50), (260, 50), (260, 200), (60, 200)], slope)) < 1.5


def test_a_step_in_a_side_makes_two_lines_of_it() -> None:
    found = quads(box(60, 40, 260, 190) | box(60, 35, 160, 60))
    for top in (35, 40):
        screen = [(60, top), (260, top), (260, 190), (60, 190)]
        assert any(error(quad, screen) < 1.5 for quad in found)


def test_a_dark_thing_that_merges_with_a_side_only_adds_lines() -> None:
    """The desk's edge, in three pieces, is longer than what is left of the lower side."""
    desk = box(110, 150, 300, 220)
    for x in (165, 225):
        desk &= ~box(x, 200, x + 5, 239)
    found = quads(box(60, 30, 240, 160) | desk)
    assert any(error(q, [(60, 30), (240, 30), (240, 160), (60, 160)]) < 4 for q in found)
    assert 1 < len(found) <= 6


def test_the_quadrilateral_with_most_of_its_outline_comes_first() -> None:
    """The stand's lower side is longer than the screen's, and longer than what it would make
    together with the screen's other sides."""
    quad, *_ = quads(
        box(60, 30, 200, 130)
        | inside([(105, 120), (155, 120), (155, 190), (105, 190)])
        | box(30, 185, 230, 200)
    )
    assert error(quad, [(60, 30), (200, 30), (200, 130), (60, 130)]) < 4


def test_a_disk_has_no_sides() -> None:
    assert not quads((COLUMNS - 160) ** 2 + (ROWS - 120) ** 2 < 90**2)


def test_four_lines_meet_in_the_corners_after_each_other() -> None:
    """The lines y = 1, x = 5, y = 4 and x = 2."""
    top, right, bottom, left = [0, 1, -1], [1, 0, -5], [0, 1, -4], [1, 0, -2]
    square = meet(np.array([top, right, bottom, left], np.float64))
    assert square is not None
    assert square.tolist() == [[2, 1], [5, 1], [5, 4], [2, 4]]
    with np.errstate(all="raise"):
        assert meet(np.array([top, bottom, right, left], np.float64)) is None  # parallel ones
    # Of three lines through (0, 0) and another, two corners are the same; a bow is not convex.
    bow = np.array([[0, 1, 0], [1, -1, -1], [0, 1, -2], [1, 1, -3]], np.float64)
    assert meet(bow) is None
