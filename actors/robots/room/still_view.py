"""A camera's rendering that is reused until something in view changes.

TinyRenderer, the software renderer that works without a display, needs about 20 ms for 320×240,
twenty times as long as the rest of an agent step. The robot's camera therefore renders again only
if a movable body is or was in view. The reused picture equals a new rendering, bit for bit.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from actors.robots.room.camera import Camera, Rendering


@dataclass
class StillView:
    """A camera that renders again only when the rendering would differ from the last one."""

    engine: Any
    camera: Camera
    movables: Mapping[int, Sequence[tuple[int, float]]]
    """Links that move, by body, as `Limbs.movables`."""
    appearance: Callable[[], object]
    """Returns what changes the movables' rendering beside their positions; it is called only while
    one of them may be in view."""

    def __post_init__(self) -> None:
        moving = self.movables.items()
        self._links = {body: [link for link, _ in links] for body, links in moving}
        self._radii = [radius for _, links in moving for _, radius in links]
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
            for state in self.engine.getLinkStates(body, links, computeForwardKinematics=1)
        ]
        if not self.camera.may_see((state[0] for state in states), self._radii):
            return "nothing that moves"
        return (tuple(state[:2] for state in states), self.appearance())
