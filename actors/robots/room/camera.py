"""Pinhole cameras in the room, and the mount that carries and turns a robot's camera."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.robots.room.rotation import Vector, about
from actors.vision.field_of_view import HEIGHT_ANGLE, WIDTH_ANGLE
from actors.vision.window import Window

CAMERA_SIZE = (320, 240)
"""Width and height of the robot's picture, one of the sizes that NAO's camera offers."""
# In front of the lens, so that the camera does not see it.
_NEAR = 0.03
_FAR = 10.0
_LIGHT: Vector = (-0.6, -0.5, 1.6)
"""Position of the light."""


@dataclass(frozen=True)
class Rendering:
    """A picture of the room: ``rgb uint8 [H, W, 3]``, and ``bodies int32 [H, W]``, the body at each
    pixel (−1 for none)."""

    rgb: NDArray[np.uint8]
    bodies: NDArray[np.int32]


class Camera:
    """A pinhole camera in a physics client."""

    def __init__(
        self,
        engine: Any,
        position: NDArray[np.float64],
        forward: NDArray[np.float64],
        up: NDArray[np.float64],
        *,
        size: tuple[int, int],
        angles: tuple[float, float],
    ) -> None:
        """``size`` is width and height, ``angles`` the horizontal and vertical field of view, °."""
        self.width, self.height = size
        self._engine = engine
        self.position = position
        """Position in the room, ``[3]``, m."""
        self._view = engine.computeViewMatrix(
            position.tolist(), (position + forward).tolist(), up.tolist()
        )
        self._right, self._top = (math.tan(math.radians(angle) / 2) * _NEAR for angle in angles)
        self.whole: Window = (slice(0, self.height), slice(0, self.width))
        """Window of the whole picture."""
        self._projection = self._frustum(self.whole)
        # OpenGL's matrices come column by column.
        view = np.array(self._view).reshape(4, 4).T
        self._to_clip: NDArray[np.float64] = np.array(self._projection).reshape(4, 4).T @ view
        self.attitude: NDArray[np.float64] = view[:3, :3].T * (1.0, -1.0, -1.0)
        """Rotation in the room, ``[3, 3]``: its columns point right, down and forward."""
        # A point p is in view if w ± x ≥ 0 and w ± y ≥ 0 in clip space (Gribb and Hartmann 2001).
        x, y, _, w = self._to_clip
        planes = np.array([w + y, w - y, w + x, w - x])  # most bodies are below the view
        planes /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
        self._planes: list[list[float]] = planes.tolist()

    def _frustum(self, window: Window) -> Any:
        """Returns the projection matrix of a part of the picture."""
        rows, columns = window
        left, right = (
            self._right * (2 * x / self.width - 1) for x in (columns.start, columns.stop)
        )
        top, bottom = (self._top * (1 - 2 * y / self.height) for y in (rows.start, rows.stop))
        return self._engine.computeProjectionMatrix(left, right, bottom, top, _NEAR, _FAR)

    def render(self, *, shadow: bool = True, window: Window | None = None) -> Rendering:
        """Renders the room, or a ``window`` of its picture, without the projected game.

        Without shadows, which are coarse on near objects and streak the wall, it takes half the
        time.
        """
        rows, columns = window or self.whole
        shape = (rows.stop - rows.start, columns.stop - columns.start)
        _, _, rgba, _, bodies = self._engine.getCameraImage(
            shape[1],
            shape[0],
            self._view,
            self._projection if window is None else self._frustum(window),
            lightDirection=_LIGHT,
            shadow=int(shadow),
            lightAmbientCoeff=0.72,
            lightDiffuseCoeff=0.30,
            lightSpecularCoeff=0.04,
            renderer=self._engine.ER_TINY_RENDERER,
        )
        rgb = np.asarray(rgba, np.uint8).reshape(*shape, 4)[:, :, :3].copy()
        return Rendering(rgb, np.asarray(bodies, np.int32).reshape(shape))

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the pixels (x, y) of room ``points [N, 3]``, ``float64 [N, 2]``; pixel centres
        lie at whole numbers."""
        homogeneous = np.hstack([points, np.ones((len(points), 1))]) @ self._to_clip.T
        normal = homogeneous[:, :2] / homogeneous[:, 3:]
        # TinyRenderer samples pixels at their lower left corners, not at their centres.
        x = (normal[:, 0] + 1) / 2 * self.width
        y = (1 - normal[:, 1]) / 2 * self.height - 1
        return np.stack([x, y], axis=1)

    def window_of(self, points: NDArray[np.float64]) -> Window | None:
        """Returns a close window around everything visible that lies between room ``points [N,
        3]``; None if nothing of it is in the picture."""
        if (points @ self._to_clip[3, :3] + self._to_clip[3, 3]).min() <= _NEAR:
            return self.whole
        x, y = self.project(points).T
        # One pixel more on each side, because the renderer rounds.
        top, bottom = (int(each) for each in np.clip((y.min() - 1, y.max() + 3), 0, self.height))
        left, right = (int(each) for each in np.clip((x.min() - 1, x.max() + 3), 0, self.width))
        return (slice(top, bottom), slice(left, right)) if top < bottom and left < right else None

    def may_see(self, centres: Iterable[Sequence[float]], radii: Iterable[float]) -> bool:
        """Whether any ball, given by centre (x, y, z) and radius, could be in view; there are no
        false negatives."""
        # For a dozen balls numpy takes five times as long as plain floats.
        for (x, y, z), radius in zip(centres, radii, strict=True):
            for a, b, c, d in self._planes:
                if a * x + b * y + c * z + d < -radius:
                    break
            else:
                return True
        return False


@dataclass(frozen=True)
class Mount:
    """A head that carries a robot's camera and turns about a pivot."""

    pivot: NDArray[np.float64]
    """Position of the pivot in the room, ``[3]``, m."""
    posture: NDArray[np.float64]
    """Rotation of the head in its usual posture, ``[3, 3]``."""
    lens: Vector
    """Position of the camera in the head's frame, m."""
    pitch: float
    """Downward pitch of the camera relative to the head, rad."""

    def camera(
        self,
        engine: Any,
        *,
        margin: tuple[int, int] = (0, 0),
        yaw: float = 0.0,
        pitch: float = 0.0,
    ) -> Camera:
        """Returns the robot's camera.

        Args:
            margin: Extra pixels beyond the picture's left and right, and upper and lower edges,
                which a lens's distortion brings into view; the picture's own pixels do not change.
            yaw: Degrees by which the head is turned to its left, relative to its posture.
            pitch: Degrees by which the head is tilted down, relative to its posture.
        """
        turn = about((0.0, 0.0, 1.0), math.radians(yaw)) @ self.posture
        turn = turn @ about((0.0, 1.0, 0.0), math.radians(pitch))
        position = self.pivot + turn @ np.array(self.lens)
        gaze = turn @ about((0.0, 1.0, 0.0), self.pitch)
        wide, tall = (
            2 * math.degrees(math.atan(math.tan(math.radians(angle) / 2) * (1 + 2 * more / pixels)))
            for angle, more, pixels in zip(
                (WIDTH_ANGLE, HEIGHT_ANGLE), margin, CAMERA_SIZE, strict=True
            )
        )
        whole = (CAMERA_SIZE[0] + 2 * margin[0], CAMERA_SIZE[1] + 2 * margin[1])
        return Camera(engine, position, gaze[:, 0], gaze[:, 2], size=whole, angles=(wide, tall))
