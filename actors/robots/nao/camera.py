"""Cameras in the room, and NAO's own one with the part of its picture that stands still.

TinyRenderer, the software renderer that works without a display, needs about 20 ms for 320×240,
twenty times what everything else in a decision costs. So NAO's camera renders again only if
something that moves was or is in its view, and then gives the same picture, bit for bit.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.robots.nao.anatomy import TOP_CAMERA_ORIGIN, TOP_CAMERA_PITCH, Vector
from actors.robots.nao.assembly import place_in_piece
from actors.robots.nao.posture import TORSO_ORIGIN
from actors.robots.nao.rotation import about
from actors.vision.optics import HEIGHT_ANGLE, WIDTH_ANGLE

CAMERA_SIZE = (320, 240)
"""Width and height of the robot's picture, of those that NAO's camera offers."""
# In front of the forehead, so that the camera does not look at its own lens.
_NEAR = 0.03
_FAR = 10.0
_LIGHT: Vector = (-0.6, -0.5, 1.6)
"""Where the light comes from."""


@dataclass(frozen=True)
class Rendering:
    """A picture of the room: ``rgb uint8 [H, W, 3]`` and the body at each pixel, ``int32 [H, W]``
    (−1 where there is none)."""

    rgb: NDArray[np.uint8]
    bodies: NDArray[np.int32]


class Camera:
    """A pinhole camera; angles of view in degrees."""

    def __init__(
        self,
        engine: Any,
        eye: NDArray[np.float64],
        forward: NDArray[np.float64],
        up: NDArray[np.float64],
        *,
        size: tuple[int, int],
        angles: tuple[float, float],
    ) -> None:
        """``size`` is width and height, ``angles`` those of the view's width and height."""
        self.width, self.height = size
        self._engine = engine
        self.eye = eye
        """Where it is in the room, ``[3]``."""
        self._view = engine.computeViewMatrix(eye.tolist(), (eye + forward).tolist(), up.tolist())
        right, top = (math.tan(math.radians(angle) / 2) * _NEAR for angle in angles)
        self._projection = engine.computeProjectionMatrix(-right, right, -top, top, _NEAR, _FAR)
        # OpenGL's matrices come column by column.
        view = np.array(self._view).reshape(4, 4).T
        self._to_clip: NDArray[np.float64] = np.array(self._projection).reshape(4, 4).T @ view
        # A point p is in view if w ± x ≥ 0 and w ± y ≥ 0 in clip space (Gribb and Hartmann 2001).
        x, y, _, w = self._to_clip
        planes = np.array([w + y, w - y, w + x, w - x])  # most of the room's things are below
        planes /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
        self._planes: list[list[float]] = planes.tolist()

    def render(self, *, shadow: bool = True) -> Rendering:
        """The room as it is now, without the projected game; half as slow without shadows."""
        _, _, rgba, _, bodies = self._engine.getCameraImage(
            self.width,
            self.height,
            self._view,
            self._projection,
            lightDirection=_LIGHT,
            shadow=int(shadow),
            lightAmbientCoeff=0.72,
            lightDiffuseCoeff=0.30,
            lightSpecularCoeff=0.04,
            renderer=self._engine.ER_TINY_RENDERER,
        )
        shape = (self.height, self.width)
        rgb = np.asarray(rgba, np.uint8).reshape(*shape, 4)[:, :, :3].copy()
        return Rendering(rgb, np.asarray(bodies, np.int32).reshape(shape))

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where ``points [N, 3]`` of the room are in the picture: ``float64 [N, 2]``, x and y; at
        whole numbers lies what that pixel shows."""
        homogeneous = np.hstack([points, np.ones((len(points), 1))]) @ self._to_clip.T
        normal = homogeneous[:, :2] / homogeneous[:, 3:]
        # TinyRenderer looks through its pixels' lower left corners, not through their middles.
        x = (normal[:, 0] + 1) / 2 * self.width
        y = (1 - normal[:, 1]) / 2 * self.height - 1
        return np.stack([x, y], axis=1)

    def may_see(self, centres: Iterable[Sequence[float]], radii: Iterable[float]) -> bool:
        """Whether any ball, of a centre (x, y, z) and a radius, could be in view; never wrongly
        no."""
        # Plain numbers: for a dozen balls numpy takes five times as long.
        for (x, y, z), radius in zip(centres, radii, strict=True):
            for a, b, c, d in self._planes:
                if a * x + b * y + c * z + d < -radius:
                    break
            else:
                return True
        return False


def top_camera(
    engine: Any,
    size: tuple[int, int] = CAMERA_SIZE,
    *,
    margin: tuple[int, int] = (0, 0),
    yaw: float = 0.0,
    pitch: float = 0.0,
) -> Camera:
    """The camera in NAO's forehead.

    Args:
        engine: The physics client.
        size: Width and height of its picture.
        margin: Pixels that are seen beyond the picture's left or right, and upper or lower edge,
            for a lens that brings them in; the picture's own pixels stay what they are.
        yaw: Degrees by which the head is turned to its left, away from its posture.
        pitch: Degrees by which it is bent down.
    """
    _, posture, neck = place_in_piece("head")
    turn = about((0.0, 0.0, 1.0), math.radians(yaw)) @ posture
    turn = turn @ about((0.0, 1.0, 0.0), math.radians(pitch))
    eye = np.array(TORSO_ORIGIN) + neck + turn @ np.array(TOP_CAMERA_ORIGIN)
    gaze = turn @ about((0.0, 1.0, 0.0), TOP_CAMERA_PITCH)
    wide, tall = (
        2 * math.degrees(math.atan(math.tan(math.radians(angle) / 2) * (1 + 2 * more / pixels)))
        for angle, more, pixels in zip((WIDTH_ANGLE, HEIGHT_ANGLE), margin, size, strict=True)
    )
    seen = (size[0] + 2 * margin[0], size[1] + 2 * margin[1])
    return Camera(engine, eye, gaze[:, 0], gaze[:, 2], size=seen, angles=(wide, tall))


@dataclass(frozen=True)
class Movable:
    """Something that moves, for the question whether it is in view."""

    body: int
    link: int
    radius: float
    """m around its centre of mass, beyond which nothing of it is drawn."""


class StillView:
    """A camera's rendering, made anew only when it would differ from the last one."""

    def __init__(
        self, engine: Any, camera: Camera, movables: list[Movable], look: Callable[[], object]
    ) -> None:
        """``look`` tells what else, beside positions, changes how the movables are drawn; it is
        asked only while one of them may be in view."""
        self.camera = camera
        self.renderings = 0
        self._engine = engine
        self._look = look
        self._links: dict[int, list[int]] = {}
        for movable in movables:
            self._links.setdefault(movable.body, []).append(movable.link)
        self._radii = [m.radius for body in self._links for m in movables if m.body == body]
        self._drawn: object = None
        self._last: Rendering | None = None

    def rendering(self) -> Rendering:
        """Equal, pixel for pixel, to ``camera.render()`` now; not to be written to."""
        scene = self._scene()
        if self._last is None or scene != self._drawn:
            self._last = self.camera.render()
            self._drawn = scene
            self.renderings += 1
        return self._last

    def _scene(self) -> object:
        """Something that differs whenever what is in view differs."""
        states = [
            state
            for body, links in self._links.items()
            for state in self._engine.getLinkStates(body, links, computeForwardKinematics=1)
        ]
        if not self.camera.may_see((state[0] for state in states), self._radii):
            return "nothing that moves"
        return (tuple(state[:2] for state in states), self._look())
