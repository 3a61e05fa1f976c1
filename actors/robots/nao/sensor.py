"""What a real camera does to a picture: lens, blur, gains, noise and delay, as far as asked for.

All of it is off by default and then costs nothing. What differs from game to game is drawn from
the environment's generator at the game's start, so that a seed still tells the whole game.
"""

from collections import deque

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.vision.lens import Lens
from common.run.config import CameraConfig

PERFECT_CAMERA = CameraConfig()
"""A camera without any fault."""

_GRAIN_FRAMES = 4
"""Pictures' worth of noise that is drawn per game; each picture gets a random stretch of it,
because drawing anew for every pixel would take longer than everything else in a decision."""


class Sensor:
    """The way from what a pinhole would see to the picture that the robot gets.

    Call `begin_game` before the first picture of each game.
    """

    def __init__(self, config: CameraConfig, size: tuple[int, int] = (320, 240)) -> None:
        """``size`` is the picture's width and height."""
        self.lens = Lens(config.distortion, size) if config.distortion > 0 else None
        self._config = config
        self._gains: NDArray[np.uint8] | None = None
        self._grain: NDArray[np.int8] | None = None
        self._shape = (size[1], size[0], 3)
        self._rng: Generator | None = None
        self._now = 0  # decisions
        self._late: deque[tuple[int, NDArray[np.uint8]]] = deque()

    def begin_game(self, rng: Generator) -> None:
        """Draw what differs from game to game, and forget the pictures of the last one."""
        config = self._config
        self._late.clear()
        if config.exposure > 0 or config.colour_gain > 0:
            exposure = 1 + rng.uniform(-config.exposure, config.exposure)
            gains = exposure * (1 + rng.uniform(-config.colour_gain, config.colour_gain, 3))
            table = np.rint(np.arange(256)[:, None] * gains)
            self._gains = np.clip(table, 0, 255).astype(np.uint8)[None]
        if config.noise > 0:
            self._rng = np.random.default_rng(rng.integers(2**63))
            size = _GRAIN_FRAMES * int(np.prod(self._shape))
            grain = config.noise * self._rng.standard_normal(size, np.float32)
            self._grain = np.clip(np.rint(grain), -127, 127).astype(np.int8)

    def take(self, ideal: NDArray[np.uint8], decisions: int = 1) -> NDArray[np.uint8]:
        """The robot's picture, ``uint8 [height, width, 3]``.

        Args:
            ideal: What a pinhole sees now, larger by the lens's margin if there is a lens. With
                a perfect camera the very same array is given back.
            decisions: How many have passed since the last one was taken.
        """
        image = ideal
        if self.lens is not None:
            image = self.lens.photograph(image)
        if self._config.blur > 0:
            blurred = cv2.GaussianBlur(image, (0, 0), self._config.blur)
            image = np.asarray(blurred, np.uint8)
        if self._gains is not None:
            image = np.asarray(cv2.LUT(image, self._gains), np.uint8)
        if self._grain is not None and self._rng is not None:
            start = self._rng.integers(len(self._grain) - image.size + 1)
            grain = self._grain[start : start + image.size].reshape(self._shape)
            image = np.asarray(cv2.add(image, grain, dtype=cv2.CV_8U), np.uint8)
        self._now += decisions
        self._late.append((self._now, image))
        # The newest that is late enough; a game's first one until later ones have come through.
        while len(self._late) > 1 and self._late[1][0] <= self._now - self._config.latency:
            self._late.popleft()
        return self._late[0][1]
