"""A detected screen is kept while nothing changes along its edges, and it is unwarped."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from actors.vision.layout import BORDER, GAME_IN_PICTURE
from actors.vision.screen import Screen

OUTER = np.array([[60.0, 40.0], [250.0, 46.0], [244.0, 190.0], [66.0, 182.0]], np.float32)


def picture() -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(256, size=(240, 320), dtype=np.uint8)


def middle() -> NDArray[np.float64]:
    """Returns the pixel of the projected picture's centre, where its diagonals meet."""
    left_top, right_top, right_low, left_low = OUTER.astype(float)
    ways = np.column_stack([right_low - left_top, right_top - left_low])
    share: float = np.linalg.solve(ways, right_top - left_top)[0]
    return np.asarray(left_top + share * (right_low - left_top), np.float64)


def test_the_middle_of_the_picture_is_the_middle_of_the_frame() -> None:
    x, y = np.round(middle()).astype(int)
    grey = np.zeros((240, 320), np.uint8)
    grey[y - 3 : y + 4, x - 3 : x + 4] = 255
    screen = Screen(OUTER, grey)
    frame = screen.unwarp(grey[screen.window]).astype(float)
    rows, columns = np.nonzero(frame > 127)
    assert abs(rows.mean() - 41.5) < 0.5
    assert abs(columns.mean() - 41.5) < 0.5


def test_no_dot_is_lost_between_the_samples() -> None:
    """A pixel of the frame is made of 2.1 by 2.1 of the camera's: each counts, wherever it is."""
    outer = np.array([[50, 15], [255, 15], [255, 220], [50, 220]], np.float32)
    screen = Screen(outer, picture())
    wide = 205 / (1 + 2 * BORDER) / 84
    for shift in range(24):
        grey = np.zeros((240, 320), np.uint8)
        grey[100 + shift, 150 - shift] = 255
        total = screen.unwarp(grey[screen.window]).sum()
        assert total == pytest.approx(255 / wide**2, rel=0.15)


def test_the_outline_is_in_the_window_around_it() -> None:
    grey = np.full((240, 320), 200, np.uint8)
    cv2.fillConvexPoly(grey, OUTER.astype(np.int32), 0)
    screen = Screen(OUTER, grey)
    around = np.zeros_like(grey)
    around[screen.around] = grey[screen.around]
    shares = screen.outline.in_place(grey, 50.0)
    assert shares.min() > 0.7  # stairs of whole pixels hide some
    assert np.array_equal(screen.outline.in_place(around, 50.0), shares)


def test_corners_lie_a_border_within() -> None:
    """The game's corners lie on the picture's diagonals, nearer to the centre."""
    screen = Screen(OUTER, picture())
    centre = middle()
    for outer, inner in zip(OUTER, screen.corners, strict=True):
        across, along = outer - centre, inner - centre
        turn = across[0] * along[1] - across[1] * along[0]
        assert abs(turn) / np.linalg.norm(across) < 0.01
        share = np.linalg.norm(along) / np.linalg.norm(across)
        assert abs(share - 1 / (1 + 2 * BORDER)) < 0.02
    assert np.allclose(GAME_IN_PICTURE[0], BORDER / (1 + 2 * BORDER))


def test_only_the_band_along_the_edges_decides() -> None:
    grey = picture()
    screen = Screen(OUTER, grey)

    def still(changed: NDArray[np.uint8]) -> bool:
        return screen.is_still_in(changed[screen.window])

    assert still(grey)
    game, far = grey.copy(), grey.copy()
    cv2.fillConvexPoly(game, np.rint(screen.corners).astype(np.int32), 0)
    far[:20], far[:, :30] = 0, 0
    assert still(game)
    assert still(far)
    for px, py in ((155, 43), (62, 110), (247, 120), (150, 186), (64, 44)):
        touched = grey.copy()
        touched[py, px] += 1
        assert not still(touched)


def test_a_window_at_the_pictures_edge_stays_in_it() -> None:
    outer = np.array([[0, 0], [319, 0], [319, 239], [0, 239]], np.float32)
    grey = picture()
    screen = Screen(outer, grey)
    assert grey[screen.window].shape == grey.shape
    assert screen.is_still_in(grey[screen.window])
