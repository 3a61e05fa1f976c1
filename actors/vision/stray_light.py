"""Light on the projection screen that is not the game's: ambient light, and the glare of a lamp.

The darker a point, the more stray light adds to it. White stays white, because the camera's
exposure follows the brightest point. A brightness v of 255 becomes ``v + a (255 - v)``, where ``a``
is the stray light at that point as a share of white.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.vision.layout import ASPECT
from common.settings.conditions import CameraConfig

GLARE_RADIUS = 0.15
"""Standard deviation of the glare's round blob, as a share of the projected picture's width."""


class StrayLight:
    """The stray light on a part of the screen, pixel by pixel."""

    def __init__(self, camera: CameraConfig, places: NDArray[np.float64], channels: int) -> None:
        """``places [rows, columns, 2]`` has each pixel's place (x, y) in the projected picture,
        which spans (0, 0) to (1, 1) with its border."""
        across, down = places[..., 0] - camera.glare_x, (places[..., 1] - camera.glare_y) / ASPECT
        glare = camera.glare * np.exp(-(across**2 + down**2) / (2 * GLARE_RADIUS**2))
        kept = (1 - camera.ambient) * (1 - glare)
        self.share: NDArray[np.float64] = 1 - kept
        """Share of white at each pixel, ``float64 [rows, columns]``."""
        self._kept = np.rint(255 * np.repeat(kept[..., None], channels, axis=2)).astype(np.uint8)

    def shine(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Returns ``picture uint8 [rows, columns, channels]`` under this light; with one channel,
        ``uint8 [rows, columns]``."""
        # The distance to white, 255 - v, shrinks to the share that the light leaves.
        missing = cv2.multiply(cv2.bitwise_not(picture), self._kept, scale=1 / 255)
        return np.asarray(cv2.bitwise_not(missing), np.uint8)


def has_stray_light(camera: CameraConfig) -> bool:
    """Whether the settings put any light on the screen that is not the game's."""
    return camera.ambient > 0 or camera.glare > 0
