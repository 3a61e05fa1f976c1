"""The room as shapes and their poses, for viewers that render it themselves."""

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.robots.room.engine import Quaternion, angles_of, frame_of
from actors.robots.room.rotation import Vector
from actors.robots.room.urdf import BALL_MESH

_CUBE = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)


class DrawnShape(NamedTuple):
    """A shape as it is drawn, in its link's frame; lengths in m."""

    kind: Literal["box", "rod", "egg"]
    size: Vector
    """Edges of a box; length, radius and 0 of a rod along z; half axes of an egg."""
    origin: Vector
    turn: Quaternion
    colour: tuple[float, float, float, float]


class Scene:
    """The visible shapes in a physics client.

    Args:
        names: names of the bodies by number. If a body has joints, its links are named
            ``BODY/LINK``.
        robot: body of the robot.
    """

    def __init__(self, engine: Any, names: Mapping[int, str], robot: int) -> None:
        self._engine = engine
        self._robot = robot
        self.shapes: dict[str, list[DrawnShape]] = {}
        """Shapes of each visible link by its name, without meshes other than balls."""
        self.whole = True
        """Whether no shape was left out."""
        self._links: dict[str, tuple[int, int]] = {}
        for body, name in names.items():
            for data in engine.getVisualShapeData(body):
                if (shape := _shape(engine, data)) is None:
                    self.whole = False
                else:
                    link = _name(engine, body, data[1], name)
                    self._links[link] = (body, data[1])
                    self.shapes.setdefault(link, []).append(shape)

        self._corners = {
            name: np.concatenate([_corners(engine, shape) for shape in shapes])
            for name, shapes in self.shapes.items()
        }

    def corners(self) -> dict[str, NDArray[np.float64]]:
        """Returns the corners of the boxes around each visible link's shapes, by the link's name.

        They are present places in the room, m, ``float64 [N, 3]``.
        """
        return {
            name: _placed(self._engine, corners, *frame_of(self._engine, *self._links[name]))
            for name, corners in self._corners.items()
        }

    def poses(self) -> dict[str, NDArray[np.float64]]:
        """Returns the present pose in the room of each visible link's frame, by the link's name.

        A pose is position, m, and quaternion (x, y, z, w), ``float64 [7]``.
        """
        return {
            name: np.hstack(frame_of(self._engine, *link)) for name, link in self._links.items()
        }

    def joints(self) -> dict[str, float]:
        """Returns the present angle of each of the robot's hinges, rad, by its name."""
        return angles_of(self._engine, self._robot)


def _shape(engine: Any, data: tuple[Any, ...]) -> DrawnShape | None:
    _, _, kind, size, mesh, *place = data
    if kind == engine.GEOM_BOX:
        return DrawnShape("box", size, *place)
    if kind == engine.GEOM_CYLINDER:
        return DrawnShape("rod", size, *place)
    if kind == engine.GEOM_SPHERE:
        return DrawnShape("egg", (size[0],) * 3, *place)
    if kind == engine.GEOM_MESH and mesh.decode().endswith(BALL_MESH):
        return DrawnShape("egg", size, *place)
    return None


def _corners(engine: Any, shape: DrawnShape) -> NDArray[np.float64]:
    """Returns the corners of the box around ``shape``, in its link's frame, ``float64 [8, 3]``."""
    half: Vector = shape.size
    if shape.kind == "box":
        half = (half[0] / 2, half[1] / 2, half[2] / 2)
    elif shape.kind == "rod":
        length, radius, _ = shape.size
        half = (radius, radius, length / 2)
    return _placed(engine, _CUBE * half, shape.origin, shape.turn)


def _placed(
    engine: Any, points: NDArray[np.float64], position: Vector, turn: Quaternion
) -> NDArray[np.float64]:
    matrix = np.array(engine.getMatrixFromQuaternion(turn)).reshape(3, 3)
    return np.asarray(points @ matrix.T + position, np.float64)


def _name(engine: Any, body: int, link: int, name: str) -> str:
    if engine.getNumJoints(body) == 0:
        return name
    own = engine.getBodyInfo(body)[0] if link < 0 else engine.getJointInfo(body, link)[12]
    return f"{name}/{own.decode()}"
