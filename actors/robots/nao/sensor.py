"""Model of the camera's sensor: lens, blur, gains, noise and latency, as configured.

Every fault is off by default and then costs nothing. Faults that differ between games are drawn
from the environment's generator at the start of a game, so a seed still determines the whole game.
"""

from collections import deque

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.vision.lens import Lens
from common.run.config import CameraConfig

PERFECT_CAMERA = CameraConfig()
"""Settings of a camera without faults."""

_GRAIN_FRAMES = 4
"""Noise drawn per game, in pictures. Each picture gets a random section of it, because drawing
noise for every pixel would take longer than everything else in an agent step."""


class Sensor:
    """Turns a pinhole's picture into the picture that the robot gets.

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
        self._now = 0  # agent steps
        self._late: deque[tuple[int, NDArray[np.uint8]]] = deque()

    def begin_game(self, rng: Generator) -> None:
        """Draw the faults of a new game, and discard pictures of the last one."""
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

    def take(self, ideal: NDArray[np.uint8], agent_steps: int = 1) -> NDArray[np.uint8]:
        """Returns the robot's picture, ``uint8 [height, width, 3]``.

        Args:
            ideal: The pinhole's present picture, larger by the lens's margin if there is a lens. A
                perfect camera returns this same array.
            agent_steps: Agent steps since the last picture was taken.
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
        self._now += agent_steps
        self._late.append((self._now, image))
        # The newest picture that is late enough; a game's first one until a later one is.
        while len(self._late) > 1 and self._late[1][0] <= self._now - self._config.latency:
            self._late.popleft()
        return self._late[0][1]
