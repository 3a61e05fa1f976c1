"""A camera picture as the screen detector sees it: grey, and without the lens's distortion.

Only requested parts are made, because a whole picture takes as long as everything else in a
detection.
"""

from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.vision.lens import Lens
from actors.vision.window import Window


class PinholeView:
    """The camera's ``image uint8 [height, width, 3]`` as a pinhole would show it, in grey."""

    def __init__(self, image: NDArray[np.uint8], lens: Lens | None) -> None:
        self._image = image
        self._lens = lens

    @cached_property
    def as_taken(self) -> NDArray[np.uint8]:
        """The whole picture with the lens's distortion, grey, ``uint8 [height, width]``."""
        return _grey(self._image)

    @cached_property
    def whole(self) -> NDArray[np.uint8]:
        """The whole view, ``uint8 [height, width]``."""
        return self.as_taken if self._lens is None else self._lens.straighten(self.as_taken)

    def part(self, window: Window) -> NDArray[np.uint8]:
        """Returns a ``window`` of the view."""
        if "whole" in self.__dict__:
            return self.whole[window]
        if self._lens is None:
            return _grey(self._image[window])
        return self._lens.straighten(self.as_taken, window)

    def around(self, window: Window) -> NDArray[np.uint8]:
        """Returns the view at its full size; only its ``window`` has to be right."""
        if self._lens is None:
            return self.as_taken
        view = np.zeros_like(self.as_taken)
        view[window] = self.part(window)
        return view


def _grey(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
