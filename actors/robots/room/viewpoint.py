"""Pictures of a room for people, from any viewpoint."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.robots.room.camera import Camera, Rendering
from actors.robots.room.projector import Projection
from actors.robots.room.rotation import Vector, about
from actors.robots.room.scene import Scene
from actors.vision.window import Window

_MAX_KEPT = 8
"""Maximum number of views kept between pictures; an orbiting view is kept at its last turn."""
_SEEN = 0.1
"""Minimum movement that is drawn, m times the picture's width. It is less than half a pixel;
smaller movements are ignored, because motors are never quite still."""
_BEYOND = (174, 181, 189)
"""Colour beyond the room, about that of its wall: a visitor may look past it."""


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
    turn: float
    camera: Camera
    projection: Projection | None
    """None where the screen is behind the viewer."""
    rendering: Rendering | None = None
    appearance: object = None
    """What changed the rendering beside movements."""
    corners: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    """Corners of each link when it was last rendered."""


@dataclass
class Views:
    """Renders the room of ``engine`` with the game on its screen, from any viewpoint."""

    engine: Any
    screen_body: int
    """Shows the game."""
    screen_shape: tuple[int, int]
    """Rows and columns of the game."""
    corners: NDArray[np.float64]
    """Corners of the projected picture in the room, ``[4, 3]``, m."""
    find_scene: Callable[[], Scene] | None = None
    """Returns what is drawn and where, so that less has to be rendered; None if unknown."""

    def __post_init__(self) -> None:
        self._scene: Scene | None = None
        self._views: dict[tuple[Viewpoint, int, int], _View] = {}
        """The views used last, the latest last."""

    def picture(
        self,
        viewpoint: Viewpoint,
        game: NDArray[np.uint8],
        width: int,
        height: int,
        *,
        moved: bool = True,
        turn: float = 0.0,
        appearance: object = None,
    ) -> NDArray[np.uint8]:
        """Returns the present room, ``uint8 [height, width, 3]``.

        Args:
            moved: whether to render again; otherwise only the game is redrawn.
            turn: see `Viewpoint.turned`.
            appearance: a value that differs whenever moving parts have other colours.
        """
        key = (viewpoint, width, height)
        view = self._views.pop(key, None)
        if view is None or view.turn != turn:
            view = self._prepare(viewpoint, width, height, turn)
            for oldest in list(self._views)[: 1 - _MAX_KEPT]:
                del self._views[oldest]
        self._views[key] = view
        if moved or view.rendering is None:
            view.rendering = self._rendering(view, appearance)
        if view.projection is None:
            return view.rendering.rgb.copy()
        return view.projection.draw(view.rendering, game)

    def _prepare(self, viewpoint: Viewpoint, width: int, height: int, turn: float) -> _View:
        camera = viewpoint.turned(turn).camera(self.engine, width, height)
        if not camera.may_see(self.corners.tolist(), [0.0] * len(self.corners)):
            return _View(turn, camera, None)
        projection = Projection(camera, self.corners, self.screen_body, self.screen_shape)
        return _View(turn, camera, projection)

    def _rendering(self, view: _View, appearance: object) -> Rendering:
        """Returns the present rendering: the last one, with the window in which something moved
        rendered again."""
        if self._scene is None and self.find_scene is not None:
            self._scene = self.find_scene()
        if self._scene is None or not self._scene.whole:
            return _rendered(view.camera)
        last, before, now = view.rendering, view.corners, self._scene.corners()
        # A key that changes its colour has moved, however little.
        least = _SEEN / view.camera.width if appearance == view.appearance else 0.0
        view.appearance = appearance
        if last is None:
            view.corners = now
            return _rendered(view.camera)
        moved = [name for name in now if abs(now[name] - before[name]).max() > least]
        if not moved:
            return last
        points = np.concatenate([at[name] for at in (before, now) for name in moved])
        before |= {name: now[name] for name in moved}
        if (window := view.camera.window_of(points)) is None:
            return last
        part = _rendered(view.camera, window)
        rgb, bodies = last.rgb.copy(), last.bodies.copy()
        rgb[window], bodies[window] = part.rgb, part.bodies
        return Rendering(rgb, bodies)


def _rendered(camera: Camera, window: Window | None = None) -> Rendering:
    rendering = camera.render(shadow=False, window=window)
    rendering.rgb[rendering.bodies < 0] = _BEYOND  # else white
    return rendering
