"""The pinhole's view: whole or in parts the same, and the camera's own grey without a lens."""

import cv2
import numpy as np
import pytest

from actors.vision.lens import Lens
from actors.vision.pinhole import PinholeView

IMAGE = np.random.default_rng(0).integers(256, size=(240, 320, 3), dtype=np.uint8)
WINDOW = (slice(40, 140), slice(90, 230))


@pytest.mark.parametrize("lens", [None, Lens(0.06, (320, 240))])
def test_parts_are_those_of_the_whole(lens: Lens | None) -> None:
    grey = np.asarray(cv2.cvtColor(IMAGE, cv2.COLOR_RGB2GRAY), np.uint8)
    whole = grey if lens is None else lens.straighten(grey)
    assert np.array_equal(PinholeView(IMAGE, lens).whole, whole)
    assert np.array_equal(PinholeView(IMAGE, lens).as_taken, grey)
    assert np.array_equal(PinholeView(IMAGE, lens).part(WINDOW), whole[WINDOW])
    around = PinholeView(IMAGE, lens).around(WINDOW)
    assert around.shape == (240, 320)
    assert np.array_equal(around[WINDOW], whole[WINDOW])
    view = PinholeView(IMAGE, lens)
    assert view.whole is view.whole
    assert np.shares_memory(view.part(WINDOW), view.whole)
