"""A camera's rendering that is reused until something in view changes.

TinyRenderer, the software renderer that works without a display, needs about 20 ms for 320×240,
twenty times as long as the rest of an agent step. The robot's camera therefore renders again only
if a movable body is or was in view. The reused picture equals a new rendering, bit for bit.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from actors.robots.room.camera import Camera, Rendering


@dataclass(frozen=True)
class Movable:
    """A link that moves, with the ball in which it is drawn."""

    body: int
    link: int
    radius: float
    """Radius around its centre of mass that holds everything drawn of it, m."""


class StillView:
    """A camera that renders again only when the rendering would differ from the last one."""

    def __init__(
        self, engine: Any, camera: Camera, movables: list[Movable], appearance: Callable[[], object]
    ) -> None:
        """``appearance`` returns what changes the movables' rendering beside their positions; it is
        called only while one of them may be in view."""
        self.camera = camera
        self._engine = engine
        self._appearance = appearance
        self._links: dict[int, list[int]] = {}
        for movable in movables:
            self._links.setdefault(movable.body, []).append(movable.link)
        self._radii = [m.radius for body in self._links for m in movables if m.body == body]
        self._drawn: object = None
        self._last: Rendering | None = None

    def rendering(self) -> Rendering:
        """Returns a rendering equal to ``camera.render()``, bit for bit; do not write to it."""
        scene = self._scene()
        if self._last is None or scene != self._drawn:
            self._last = self.camera.render()
            self._drawn = scene
        return self._last

    def _scene(self) -> object:
        """Returns a value that differs whenever the view differs."""
        states = [
            state
            for body, links in self._links.items()
            for state in self._engine.getLinkStates(body, links, computeForwardKinematics=1)
        ]
        if not self.camera.may_see((state[0] for state in states), self._radii):
            return "nothing that moves"
        return (tuple(state[:2] for state in states), self._appearance())
