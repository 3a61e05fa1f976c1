"""Pictures of a room for people, from any viewpoint."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.robots.room.camera import Camera, Rendering
from actors.robots.room.furniture import PICTURE_CORNERS
from actors.robots.room.projector import Projection
from actors.robots.room.rotation import Vector, about

_MOST_KEPT = 8
"""Views that are kept between pictures: a view that turns is another in each."""


@dataclass(frozen=True)
class Viewpoint:
    """Position and direction of a visitor's view; lengths in m, in the room."""

    position: Vector
    target: Vector
    angle: float
    """Vertical field of view, degrees."""

    def camera(self, engine: Any, width: int, height: int) -> Camera:
        """Returns a camera at this viewpoint; a wider picture shows more to the sides."""
        wide = 2 * math.atan(math.tan(math.radians(self.angle) / 2) * width / height)
        position = np.array(self.position)
        return Camera(
            engine,
            position,
            np.array(self.target) - position,
            np.array([0.0, 0.0, 1.0]),
            size=(width, height),
            angles=(math.degrees(wide), self.angle),
        )

    def turned(self, angle: float) -> "Viewpoint":
        """Returns the viewpoint after a turn by ``angle`` degrees about the vertical through its
        target, counterclockwise from above."""
        x, y, z = about((0.0, 0.0, 1.0), math.radians(angle)) @ (
            np.array(self.position) - self.target
        )
        right, front, up = self.target
        return replace(self, position=(right + x, front + y, up + z))


VISITOR = Viewpoint((-0.60, -1.05, 0.85), (0.50, 0.0, 0.335), 40.0)
"""View of the whole room: robot, desk and screen."""


@dataclass
class _View:
    camera: Camera
    projection: Projection | None
    """None where the screen is behind the viewer."""
    rendering: Rendering | None = None


class Views:
    """Renders one room with the game on its screen, from any viewpoint."""

    def __init__(
        self,
        engine: Any,
        screen_body: int,
        game_size: tuple[int, int],
        picture_corners: NDArray[np.float64] = PICTURE_CORNERS,
    ) -> None:
        """``screen_body`` shows the game, of ``game_size`` rows and columns, between
        ``picture_corners``."""
        self._engine = engine
        self._screen_body = screen_body
        self._game_size = game_size
        self._corners = picture_corners
        self._views: dict[tuple[Viewpoint, int, int], _View] = {}
        """Those that were used last, the latest last."""

    def picture(
        self,
        viewpoint: Viewpoint,
        game: NDArray[np.uint8],
        width: int,
        height: int,
        *,
        moved: bool = True,
    ) -> NDArray[np.uint8]:
        """Returns the present room, ``uint8 [height, width, 3]``.

        Without ``moved`` only the game is drawn anew, over the last rendering.
        """
        key = (viewpoint, width, height)
        view = self._views.pop(key, None)
        if view is None:
            view = self._prepare(viewpoint.camera(self._engine, width, height))
            for oldest in list(self._views)[: 1 - _MOST_KEPT]:
                del self._views[oldest]
        self._views[key] = view
        if moved or view.rendering is None:
            view.rendering = view.camera.render(shadow=False)
        if view.projection is None:
            return view.rendering.rgb
        return view.projection.draw(view.rendering, game)

    def _prepare(self, camera: Camera) -> _View:
        if not camera.may_see(self._corners.tolist(), [0.0] * len(self._corners)):
            return _View(camera, None)
        projection = Projection(camera, self._corners, self._screen_body, self._game_size)
        return _View(camera, projection)
