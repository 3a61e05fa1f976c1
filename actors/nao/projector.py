"""The projector: the game's picture, with its black border, on the screen before the robot.

TinyRenderer ignores a texture that changes, so the picture is drawn into a camera's image
afterwards: by the homography of the screen's corners, and only on pixels where the screen is
what the camera sees, so that whatever stands in front hides it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.nao.camera import Camera, Rendering
from actors.vision.layout import GAME_IN_PICTURE


class Projection:
    """The picture on the screen as one camera sees it, for games of one size."""

    def __init__(
        self,
        camera: Camera,
        corners: NDArray[np.float64],
        screen_body: int,
        game_size: tuple[int, int],
    ) -> None:
        """``corners [4, 3]`` are the picture's in the room, from the top left clockwise as the
        audience sees it; ``game_size`` is rows and columns."""
        self._screen_body = screen_body
        rows, columns = game_size
        seen = camera.project(corners).astype(np.float32)
        picture = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
        to_picture = cv2.getPerspectiveTransform(seen, picture)
        # The game's outermost edges, half a pixel outside the middles of its first and last one.
        edges = np.array(
            [
                [-0.5, -0.5],
                [columns - 0.5, -0.5],
                [columns - 0.5, rows - 0.5],
                [-0.5, rows - 0.5],
            ],
            np.float32,
        )
        to_game = cv2.getPerspectiveTransform(GAME_IN_PICTURE, edges) @ to_picture

        left, top = np.maximum(np.floor(seen.min(axis=0)).astype(int), 0)
        right, bottom = np.ceil(seen.max(axis=0)).astype(int) + 1
        right, bottom = min(right, camera.width), min(bottom, camera.height)
        self._window = (slice(top, bottom), slice(left, right))
        x, y = np.meshgrid(np.arange(left, right), np.arange(top, bottom))
        pixels = np.stack([x, y], axis=2).astype(np.float64)
        in_picture = cv2.perspectiveTransform(pixels, to_picture)
        self._on_picture = ((in_picture >= 0) & (in_picture <= 1)).all(axis=2)
        in_game = cv2.perspectiveTransform(pixels, to_game).astype(np.float32)
        self._map, self._fraction = cv2.convertMaps(in_game, None, cv2.CV_16SC2)
        self._bodies: NDArray[np.int32] | None = None
        self._lit = np.zeros((0, 0), np.uint8)

    def draw(self, rendering: Rendering, game: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """``rendering`` with ``game uint8 [rows, columns, 3]`` on its screen, a new image."""
        image = rendering.rgb.copy()
        window = image[self._window]
        light = cv2.remap(
            game,
            self._map,
            self._fraction,
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=(0, 0, 0),
        )
        # The same rendering comes again as long as nothing has moved in view.
        if rendering.bodies is not self._bodies:
            on_screen = rendering.bodies[self._window] == self._screen_body
            self._lit = (on_screen & self._on_picture).astype(np.uint8)
            self._bodies = rendering.bodies
        cv2.copyTo(light, self._lit, window)
        return image
