"""The projector: draws the game with its black border on the screen in a camera's image.

TinyRenderer ignores changes of a texture, so the picture is drawn after rendering, by the
homography of the screen's corners. It is drawn only on pixels that show the screen, so objects in
front of the screen hide it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.robots.room.camera import Camera, Rendering
from actors.robots.room.sensor import Backdrop
from actors.vision.layout import BORDER, GAME_IN_PICTURE, UNIT_SQUARE
from actors.vision.stray_light import StrayLight, has_stray_light
from actors.vision.window import window_around
from common.settings.conditions import CameraConfig

_FINER = 8
"""Samples per pixel and axis for the share of a pixel that the picture's outer edge covers."""


class Projection:
    """The projected picture in the view of one camera, for games of one size.

    The border does not change, so it is drawn once per rendering; only the game is drawn for every
    frame. Ambient light and glare shine on all of it (`StrayLight`).
    """

    def __init__(
        self,
        camera: Camera,
        corners: NDArray[np.float64],
        screen_body: int,
        screen_shape: tuple[int, int],
        light: CameraConfig | None = None,
    ) -> None:
        """``corners [4, 3]`` are the picture's corners in the room, clockwise from the top left
        from the audience's view; ``screen_shape`` is rows and columns; ``light`` has the ambient
        light and the glare, if there are any."""
        self._screen_body = screen_body
        seen = camera.project(corners).astype(np.float32)
        from_picture = cv2.getPerspectiveTransform(UNIT_SQUARE, seen)
        self._shadow = 1.0 - _coverage(camera, seen)

        game_seen = cv2.perspectiveTransform(GAME_IN_PICTURE[None], from_picture)[0]
        self._coarse = _coarse_size(screen_shape, game_seen)
        columns, rows = self._coarse
        self._shrinks = (rows, columns) != screen_shape
        to_game = _game_in_picture(columns, rows) @ np.linalg.inv(from_picture)
        self._window = window_around(game_seen, (camera.height, camera.width), more=1)
        y, x = np.mgrid[self._window]
        in_game = cv2.perspectiveTransform(np.stack([x, y], axis=2).astype(np.float64), to_game)
        # One pixel around the game included: its outermost pixels fade into the border.
        self._in_game = ((in_game > -1) & (in_game < (columns, rows))).all(axis=2)
        to_x, to_y = np.moveaxis(in_game.astype(np.float32), 2, 0)
        self._map, self._fraction = cv2.convertMaps(to_x, to_y, cv2.CV_16SC2)
        self._black: NDArray[np.float64] | float = 0.0
        """Brightness of the picture's black, ``[H, W, 1]`` under stray light."""
        self._stray: StrayLight | None = None
        """Stray light on the game."""
        if light is not None and has_stray_light(light):
            places = _places(camera, seen)
            self._black = 255.0 * StrayLight(light, places, 1).share[:, :, None]
            self._stray = StrayLight(light, places[self._window], 3)
        self._drawn: Rendering | None = None
        self._dark = np.zeros((0, 0, 3), np.uint8)
        self._lit = np.zeros((0, 0), np.uint8)

    def draw(self, rendering: Rendering, game: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Returns a new image: ``rendering`` with ``game uint8 [rows, columns, 3]`` on the
        screen."""
        # The rendering is the same object as long as nothing in view moves.
        if rendering is not self._drawn:
            self._draw_border(rendering)
        image = self._dark.copy()
        if self._shrinks:
            game = _averaged(game, self._coarse)
        light = cv2.remap(
            game, self._map, self._fraction, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT
        )
        if self._stray is not None:
            light = self._stray.shine(np.asarray(light, np.uint8))
        cv2.copyTo(light, self._lit, image[self._window])
        return image

    @property
    def backdrop(self) -> Backdrop:
        """What the last picture shares with others."""
        return Backdrop(self._dark, self._window)

    def _draw_border(self, rendering: Rendering) -> None:
        """Draws the whole picture black; pixels on its edge by the share that it covers."""
        on_screen = rendering.bodies == self._screen_body
        left = np.where(on_screen, self._shadow, 1.0)[:, :, None]
        self._dark = np.rint(rendering.rgb * left + self._black * (1 - left)).astype(np.uint8)
        self._lit = (on_screen[self._window] & self._in_game).astype(np.uint8)
        self._drawn = rendering


def _places(camera: Camera, seen: NDArray[np.float32]) -> NDArray[np.float64]:
    """Returns the place of each camera pixel in the projected picture, ``float64 [H, W, 2]``."""
    to_picture = cv2.getPerspectiveTransform(seen, UNIT_SQUARE)
    x, y = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    pixels = np.stack([x, y], axis=2).astype(np.float64)
    return np.asarray(cv2.perspectiveTransform(pixels, to_picture), np.float64)


def _game_in_picture(columns: int, rows: int) -> NDArray[np.float64]:
    """Returns the map from the projected picture, (0, 0) to (1, 1), to the game's pixels, whose
    centres lie at whole numbers."""
    span = 1 + 2 * BORDER
    return np.array(
        [
            [span * columns, 0, -BORDER * columns - 0.5],
            [0, span * rows, -BORDER * rows - 0.5],
            [0, 0, 1],
        ]
    )


def _coarse_size(screen_shape: tuple[int, int], game_seen: NDArray[np.float32]) -> tuple[int, int]:
    """Returns columns and rows to which the game is averaged before it is drawn, an integer
    fraction of its own: a camera's pixel integrates all of the game's pixels that fall on it."""
    sides = np.linalg.norm(np.roll(game_seen, -1, axis=0) - game_seen, axis=1)
    across, down = (sides[0] + sides[2]) / 2, (sides[1] + sides[3]) / 2
    rows, columns = screen_shape
    return columns // max(1, int(columns / across)), rows // max(1, int(rows / down))


def _averaged(game: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Returns ``game`` averaged to ``size`` (columns, rows)."""
    if game.shape[:2] == (2 * size[1], size[0]):  # ten times faster than resizing
        coarse = cv2.addWeighted(game[::2], 0.5, game[1::2], 0.5, 0.0)
    else:
        coarse = cv2.resize(game, size, interpolation=cv2.INTER_AREA)
    return np.asarray(coarse, np.uint8)


def _coverage(camera: Camera, seen: NDArray[np.float32]) -> NDArray[np.float64]:
    """Returns the share of each camera pixel that the picture covers, ``float64 [H, W]``.

    A camera's pixel integrates light over its area. Without this, the picture's nearly level edges
    would be up to half a pixel off.
    """
    share = np.zeros((camera.height, camera.width))
    window = window_around(seen, share.shape)
    h = cv2.getPerspectiveTransform(seen, UNIT_SQUARE)

    def inside(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
        across, down, scale = (row[0] * x + row[1] * y + row[2] for row in h)
        u, v = across / scale, down / scale
        return np.asarray((u >= 0) & (u <= 1) & (v >= 0) & (v <= 1))

    # Samples are at the centres of _FINER × _FINER parts of each pixel. The picture is convex, so a
    # pixel whose four outermost samples are inside is wholly inside.
    offsets = -0.5 + (np.arange(_FINER) + 0.5) / _FINER
    y, x = np.ogrid[window]
    outermost = [inside(x + dx, y + dy) for dx in offsets[[0, -1]] for dy in offsets[[0, -1]]]
    share[window] = whole = np.logical_and.reduce(outermost)
    rows, columns = np.nonzero(~whole)
    rows, columns = rows + window[0].start, columns + window[1].start
    parts = inside(
        columns[:, None, None] + offsets[None, None, :],
        rows[:, None, None] + offsets[None, :, None],
    )
    share[rows, columns] = parts.mean(axis=(1, 2))
    return share
