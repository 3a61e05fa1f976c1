"""Model of the camera's sensor: lens, blur, tones, noise, lost and late pictures, as configured.

A setting that changes nothing costs nothing. Noise and losses are seeded by the environment's
generator at the start of a game, so a seed still determines the whole game.
"""

from collections import deque
from typing import NamedTuple

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.vision.lens import Lens
from actors.vision.window import Window, within
from common.settings.conditions import CameraConfig

_GRAIN_FRAMES = 4
"""Noise drawn per game, in pictures. Each picture gets a random section of it, because drawing
noise for every pixel would take longer than everything else in an agent step."""


class Backdrop(NamedTuple):
    """What a pinhole's picture shares with others: everything outside a window."""

    background: object
    """The same object in every picture that is the same outside ``window``."""
    window: Window


class _Known(NamedTuple):
    """A picture before a backdrop, without noise."""

    background: object
    image: NDArray[np.uint8]
    changed: Window
    """Window that differs in other pictures before it."""
    needed: Window
    """Window that has to be developed for it."""


def newest_due(pictures: deque[tuple[int, NDArray[np.uint8]]], due: int) -> NDArray[np.uint8]:
    """Returns the newest of the ``pictures`` that were taken by ``due``, or else the first one;
    drops all before it.

    Args:
        pictures: at least one, with the agent step of each, oldest first.
    """
    while len(pictures) > 1 and pictures[1][0] <= due:
        pictures.popleft()
    return pictures[0][1]


class Sensor:
    """Turns a pinhole's picture into the picture that the robot gets.

    Call `begin_game` before the first picture of each game.
    """

    def __init__(self, config: CameraConfig, shape: tuple[int, ...] = (240, 320, 3)) -> None:
        """``shape`` is the picture's, ``(rows, columns, 3)``, or ``(rows, columns)`` if grey."""
        size = shape[1], shape[0]
        self.lens = Lens(config.distortion, size) if config.distortion > 0 else None
        self._config = config
        self._shape = shape
        self._tones = _tones(config, coloured=len(shape) == 3)
        # As far as OpenCV's kernel for that deviation reaches.
        self._reach = int(np.rint(6 * config.blur + 1)) // 2 if config.blur > 0 else 0
        self._develops = self.lens is not None or self._reach > 0 or self._tones is not None
        """Whether `_develop` changes anything."""
        self._whole: Window = (slice(0, shape[0]), slice(0, shape[1]))
        self._known: _Known | None = None
        self._grain: tuple[NDArray[np.uint8], NDArray[np.uint8]] | None = None
        """Noise that brightens, and noise that darkens."""
        self._rng = np.random.default_rng(0)
        self._now = 0  # agent steps
        self._late: deque[tuple[int, NDArray[np.uint8]]] = deque()

    def begin_game(self, rng: Generator) -> None:
        """Draws the noise of a new game, and discards pictures of the last one."""
        self._late.clear()
        noise = self._config.noise
        if noise > 0 or self._config.dropped > 0:
            self._rng = np.random.default_rng(rng.integers(2**63))
        if noise > 0:
            size = _GRAIN_FRAMES * int(np.prod(self._shape))
            grain = np.rint(noise * self._rng.standard_normal(size, np.float32))
            self._grain = (
                np.clip(grain, 0, 255).astype(np.uint8),
                np.clip(-grain, 0, 255).astype(np.uint8),
            )

    def take(
        self, ideal: NDArray[np.uint8], agent_steps: int = 1, backdrop: Backdrop | None = None
    ) -> NDArray[np.uint8]:
        """Returns the robot's picture, ``uint8`` of the sensor's ``shape``.

        Args:
            ideal: The pinhole's present picture, larger by the lens's margin if there is a lens. A
                perfect camera returns this same array.
            agent_steps: Agent steps since the last picture was taken.
            backdrop: What ``ideal`` shares with other pictures, to save time.
        """
        config = self._config
        self._now += agent_steps
        lost = config.dropped > 0 and self._rng.random() < config.dropped
        if not (lost and self._late):
            self._late.append((self._now, self._exposed(ideal, backdrop)))
        return newest_due(self._late, self._now - config.latency)

    def _exposed(self, ideal: NDArray[np.uint8], backdrop: Backdrop | None) -> NDArray[np.uint8]:
        if not self._develops:
            image = ideal
        elif backdrop is None:
            image = self._develop(ideal, self._whole)
        elif self._known is None or backdrop.background is not self._known.background:
            image = self._develop(ideal, self._whole)
            shown = backdrop.window if self.lens is None else self.lens.shown(backdrop.window)
            changed, needed = (self._grown(shown, n * self._reach) for n in (1, 2))
            self._known = _Known(backdrop.background, image, changed, needed)
        else:
            known = self._known
            image = known.image.copy()
            rows, columns = (
                slice(inner.start - outer.start, inner.stop - outer.start)
                for inner, outer in zip(known.changed, known.needed, strict=True)
            )
            image[known.changed] = self._develop(ideal, known.needed)[rows, columns]
        if self._grain is None:
            return image
        start = self._rng.integers(len(self._grain[0]) - image.size + 1)
        lighter, darker = (
            grain[start : start + image.size].reshape(self._shape) for grain in self._grain
        )
        return np.asarray(cv2.subtract(cv2.add(image, lighter), darker), np.uint8)

    def _develop(self, ideal: NDArray[np.uint8], window: Window) -> NDArray[np.uint8]:
        """Returns a ``window`` of the picture without noise, wrong within the blur's reach."""
        image = ideal[window] if self.lens is None else self.lens.photograph(ideal, window)
        if self._reach:
            size = (2 * self._reach + 1,) * 2
            image = np.asarray(cv2.GaussianBlur(image, size, self._config.blur), np.uint8)
        return image if self._tones is None else np.asarray(cv2.LUT(image, self._tones), np.uint8)

    def _grown(self, window: Window, reach: int) -> Window:
        """Returns the ``window`` with ``reach`` pixels around it, within the picture."""
        rows, columns = (
            within(each.start - reach, each.stop + reach, size)
            for each, size in zip(window, self._shape, strict=False)
        )
        return rows, columns


def _tones(config: CameraConfig, *, coloured: bool) -> NDArray[np.uint8] | None:
    """Returns the table that maps each grey level, ``uint8 [1, 256, channels]``; None if all stay
    as they are."""
    colours = (config.red, config.green, config.blue) if coloured else (1.0,)
    gains = config.brightness * np.array(colours)
    if config.gamma == 1 and (gains == 1).all():
        return None
    light = np.clip(np.arange(256)[:, None] / 255 * gains, 0, 1) ** config.gamma
    return np.rint(255 * light).astype(np.uint8)[None]
