"""A camera in front of the emulator's screen, which gives ALE-Only the faults of a robot's eye.

It looks straight at the game in its black border. The game covers as many of its pixels as of the
robot's camera, so equal noise and blur do as much to the 84×84 frame as they do to the robot's.
"""

from dataclasses import replace
from functools import partial

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.envs.eye_timing import eye_latency
from actors.envs.observation import shrink
from actors.robots.room.sensor import Sensor
from actors.vision.layout import GAME_IN_PICTURE
from actors.vision.screen import FINER
from actors.vision.stray_light import StrayLight, has_stray_light
from common.protocol.step_fields import FRAME_SHAPE
from common.settings.conditions import CameraConfig

_ROWS, _COLUMNS = 84, 112
"""Rows and columns of the robot's camera that show the game, seen from its usual place."""
_BORDER = (7, 9)
"""Rows and columns of the border on each side."""
_SHAPE = (_ROWS + 2 * _BORDER[0], _COLUMNS + 2 * _BORDER[1])
_GAME = (slice(_BORDER[0], -_BORDER[0]), slice(_BORDER[1], -_BORDER[1]))
_FINE = (FINER * FRAME_SHAPE[1], FINER * FRAME_SHAPE[0])
_GREY_NOISE = 0.67
"""Noise of a grey pixel relative to that of each of its colours, √(0.299² + 0.587² + 0.114²)."""


class FrameCamera:
    """The camera of one game; call `begin_game` first."""

    def __init__(self, camera: CameraConfig) -> None:
        self._light = StrayLight(camera, _PLACES, 1) if has_stray_light(camera) else None
        self._sensor = Sensor(replace(camera, noise=_GREY_NOISE * camera.noise), _SHAPE)

    def begin_game(self, rng: Generator) -> None:
        """Forgets all pictures; ``rng`` seeds the game's noise and losses."""
        self._sensor.begin_game(rng)

    def measure_latency(self, rng: Generator) -> int:
        """Returns the latency of the frames in agent steps, as `eye_latency` measures it. The game
        begins anew by ``rng``, so that no frame of the test is left."""
        found = eye_latency(partial(self.take, agent_steps=1), (_ROWS, _COLUMNS))
        self.begin_game(rng)
        return found

    def take(self, screen: NDArray[np.uint8], agent_steps: int) -> NDArray[np.uint8]:
        """Returns the frame ``uint8 [84, 84]`` that the camera makes of the grey ``screen``.

        ``agent_steps`` have passed since the last frame.
        """
        seen = np.zeros(_SHAPE, np.uint8)
        seen[_GAME] = cv2.resize(screen, (_COLUMNS, _ROWS), interpolation=cv2.INTER_AREA)
        if self._light is not None:
            seen = self._light.shine(seen)
        taken = self._sensor.take(seen, agent_steps)[_GAME]
        # Sampled as the screen detector samples the robot's picture.
        return shrink(np.asarray(cv2.resize(taken, _FINE), np.uint8))


def _places_in_picture() -> NDArray[np.float64]:
    """Returns where each pixel lies in the projected picture, ``float64 [*_SHAPE, 2]``."""
    (left, top), (right, bottom) = GAME_IN_PICTURE[0].tolist(), GAME_IN_PICTURE[2].tolist()
    rows, columns = np.arange(_SHAPE[0]) - _BORDER[0], np.arange(_SHAPE[1]) - _BORDER[1]
    x = left + (columns + 0.5) / _COLUMNS * (right - left)
    y = top + (rows + 0.5) / _ROWS * (bottom - top)
    return np.stack(np.meshgrid(x, y), axis=2)


_PLACES = _places_in_picture()
