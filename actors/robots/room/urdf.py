"""The text of a URDF, from parts with their shapes and the joints between them.

Each touching shape becomes a link of its own, nearly without mass and fixed to its part: the engine
predicts contacts only for links whose single shape is centred.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from actors.robots.room.rotation import Vector, from_roll_pitch_yaw
from actors.robots.room.shapes import Shape

BALL_MESH = "ball.obj"
"""File beside the URDF with the mesh of a ball of radius 1, of which eggs are made."""
TOUCH_SUFFIX = "_touch"
"""Suffix of the names of touching links."""


@dataclass
class Part:
    """A rigid part of a body, in its link's frame."""

    name: str
    mass: float = 0.0
    """kg."""
    centre: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    """Centre of mass, ``[3]``, m."""
    inertia: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3, 3)))
    """``[3, 3]`` about the centre of mass, kg·m²."""
    shapes: list[Shape] = field(default_factory=list)

    def join(self, mass: float, centre: NDArray[np.float64], inertia: NDArray[np.float64]) -> None:
        """Adds a body of ``inertia`` about its own ``centre`` of mass (parallel axis theorem)."""
        whole = self.mass + mass
        common = (self.mass * self.centre + mass * centre) / whole
        self.inertia = (
            self.inertia
            + _shifted(self.mass, common - self.centre)
            + inertia
            + _shifted(mass, common - centre)
        )
        self.mass, self.centre = whole, common

    @property
    def extent(self) -> float:
        """Radius around the centre of mass that holds all shapes, m."""
        return max(_reach(shape, self.centre) for shape in self.shapes)


def _shifted(mass: float, offset: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns what the parallel axis theorem adds to an inertia for an ``offset`` of the axis."""
    added: NDArray[np.float64] = mass * (
        float(offset @ offset) * np.eye(3) - np.outer(offset, offset)
    )
    return added


@dataclass(frozen=True)
class Joint:
    """A hinge or a slide between two links; at 0 the child's frame coincides with the joint's."""

    name: str
    parent: str
    child: str
    origin: Vector
    """Position of the joint in the parent's frame."""
    axis: Vector
    lower: float
    upper: float
    max_speed: float
    max_torque: float
    """Maximum torque of a hinge, N·m, or maximum force of a slide, N."""
    kind: Literal["revolute", "prismatic"] = "revolute"


def _reach(shape: Shape, point: NDArray[np.float64]) -> float:
    """Returns the distance from ``point`` within which all of ``shape`` lies, m."""
    away = np.array(shape.origin) - point
    if shape.kind != "box":
        radius, length, _ = shape.size
        holds = math.hypot(radius, length / 2) if shape.kind == "rod" else max(shape.size)
        return float(np.linalg.norm(away)) + holds
    corners = np.array(list(product((-0.5, 0.5), repeat=3))) * shape.size
    return float(np.linalg.norm(away + corners @ from_roll_pitch_yaw(shape.turn).T, axis=1).max())


def weighed(name: str, *pieces: tuple[Shape, float]) -> Part:
    """Returns a part of shapes, each of uniform density with its mass, kg."""
    part = Part(name)
    for shape, mass in pieces:
        turn = from_roll_pitch_yaw(shape.turn)
        inertia = turn @ np.diag(mass * np.array(_unit_inertia(shape))) @ turn.T
        part.join(mass, np.array(shape.origin), inertia)
        part.shapes.append(shape)
    return part


def _unit_inertia(shape: Shape) -> Vector:
    """Returns the inertia per kg about a shape's own axes, m²."""
    a, b, c = (edge * edge for edge in shape.size)
    if shape.kind == "box":
        return ((b + c) / 12, (a + c) / 12, (a + b) / 12)
    if shape.kind == "rod":
        return (a / 4 + b / 12, a / 4 + b / 12, a / 2)
    if shape.kind == "ball":
        return (0.4 * a, 0.4 * a, 0.4 * a)
    return ((b + c) / 5, (a + c) / 5, (a + b) / 5)


def write_urdf(folder: Path, name: str, parts: Iterable[Part], joints: Iterable[Joint]) -> Path:
    """Writes the URDF of a body, whose base is the first part, into ``folder``; returns the file's
    path."""
    parts = list(parts)
    touching = [
        _touching(part, shape, number)
        for part in parts
        for number, shape in enumerate(shape for shape in part.shapes if shape.solid)
    ]
    texts = [*map(_link, parts), *map(_joint, joints), *touching]
    path = folder / f"{name}.urdf"
    path.write_text("\n".join([f'<robot name="{name}">', *texts, "</robot>", ""]))
    return path


def _link(part: Part) -> str:
    (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = part.inertia.tolist()
    lines = [
        f'<link name="{part.name}">',
        f'<inertial><origin xyz="{_numbers(*part.centre)}"/><mass value="{part.mass:.9g}"/>'
        f'<inertia ixx="{ixx:.9g}" iyy="{iyy:.9g}" izz="{izz:.9g}" '
        f'ixy="{ixy:.9g}" ixz="{ixz:.9g}" iyz="{iyz:.9g}"/></inertial>',
    ]
    for number, shape in enumerate(part.shapes):
        if not shape.solid:
            lines.append(
                f'<visual><origin xyz="{_numbers(*shape.origin)}" rpy="{_numbers(*shape.turn)}"/>'
                f"{_visual(shape, f'{part.name}_{number}')}</visual>"
            )
    return "\n".join([*lines, "</link>"])


def _visual(shape: Shape, material: str) -> str:
    return (
        f'<geometry>{_geometry(shape)}</geometry><material name="{material}">'
        f'<color rgba="{_numbers(*shape.colour)} 1"/></material>'
    )


def _touching(part: Part, shape: Shape, number: int) -> str:
    name = f"{part.name}{TOUCH_SUFFIX}{number or ''}"
    return (
        f'<link name="{name}"><inertial><mass value="1e-6"/>'
        '<inertia ixx="1e-11" iyy="1e-11" izz="1e-11" ixy="0" ixz="0" iyz="0"/></inertial>'
        # Without a visual of its own the engine draws a collision shape white.
        f"<visual>{_visual(shape, name)}</visual>"
        f"<collision><geometry>{_geometry(shape)}</geometry></collision></link>"
        f'<joint name="{name}" type="fixed"><parent link="{part.name}"/><child link="{name}"/>'
        f'<origin xyz="{_numbers(*shape.origin)}" rpy="{_numbers(*shape.turn)}"/></joint>'
    )


def _geometry(shape: Shape) -> str:
    if shape.kind == "box":
        return f'<box size="{_numbers(*shape.size)}"/>'
    if shape.kind == "rod":
        return f'<cylinder radius="{shape.size[0]}" length="{shape.size[1]}"/>'
    if shape.kind == "ball":
        return f'<sphere radius="{shape.size[0]}"/>'
    return f'<mesh filename="{BALL_MESH}" scale="{_numbers(*shape.size)}"/>'


def _joint(joint: Joint) -> str:
    return (
        f'<joint name="{joint.name}" type="{joint.kind}">'
        f'<parent link="{joint.parent}"/><child link="{joint.child}"/>'
        f'<origin xyz="{_numbers(*joint.origin)}"/><axis xyz="{_numbers(*joint.axis)}"/>'
        f'<limit lower="{joint.lower}" upper="{joint.upper}" '
        f'velocity="{joint.max_speed}" effort="{joint.max_torque}"/></joint>'
    )


def _numbers(*numbers: float) -> str:
    return " ".join(f"{number:.9g}" for number in numbers)
