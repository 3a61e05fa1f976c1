"""NAO's URDF, written from the assembled body.

The URDF has moving joints only: a physics step then costs a fortieth of the whole robot's. Each
touching shape is a link of its own, nearly without mass and fixed to its part: the engine predicts
contacts only for links whose single shape is centred.
"""

import math
from pathlib import Path

from actors.robots.nao.anatomy import Joint
from actors.robots.nao.assembly import Piece, assemble
from actors.robots.nao.shapes import Shape

_BALL_MESH = "ball.obj"
TOUCH_SUFFIX = "_touch"
"""Suffix of the names of touching links."""


def write_urdf(folder: Path) -> Path:
    """Write the robot's URDF and the mesh of its eggs into ``folder``; returns the URDF's path."""
    (folder / _BALL_MESH).write_text(_ball_mesh())
    path = folder / "nao.urdf"
    path.write_text(nao_urdf())
    return path


def nao_urdf() -> str:
    """Returns the robot's URDF; its base is the torso, and its eggs refer to a mesh beside it."""
    pieces, joints = assemble()
    touching = [
        _touching(piece, shape)
        for piece in pieces.values()
        for shape in piece.shapes
        if shape.solid
    ]
    parts = [*map(_link, pieces.values()), *map(_joint, joints), *touching]
    return "\n".join(['<robot name="nao">', *parts, "</robot>", ""])


def _link(piece: Piece) -> str:
    (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = piece.inertia.tolist()
    lines = [
        f'<link name="{piece.name}">',
        f'<inertial><origin xyz="{_numbers(*piece.centre)}"/><mass value="{piece.mass:.9g}"/>'
        f'<inertia ixx="{ixx:.9g}" iyy="{iyy:.9g}" izz="{izz:.9g}" '
        f'ixy="{ixy:.9g}" ixz="{ixz:.9g}" iyz="{iyz:.9g}"/></inertial>',
    ]
    for number, shape in enumerate(piece.shapes):
        if not shape.solid:
            lines.append(
                f'<visual><origin xyz="{_numbers(*shape.origin)}" rpy="{_numbers(*shape.turn)}"/>'
                f"{_visual(shape, f'{piece.name}_{number}')}</visual>"
            )
    return "\n".join([*lines, "</link>"])


def _visual(shape: Shape, material: str) -> str:
    return (
        f'<geometry>{_geometry(shape)}</geometry><material name="{material}">'
        f'<color rgba="{_numbers(*shape.colour)} 1"/></material>'
    )


def _touching(piece: Piece, shape: Shape) -> str:
    name = piece.name + TOUCH_SUFFIX
    return (
        f'<link name="{name}"><inertial><mass value="1e-6"/>'
        '<inertia ixx="1e-11" iyy="1e-11" izz="1e-11" ixy="0" ixz="0" iyz="0"/></inertial>'
        # Without a visual of its own the engine draws a collision shape white.
        f"<visual>{_visual(shape, name)}</visual>"
        f"<collision><geometry>{_geometry(shape)}</geometry></collision></link>"
        f'<joint name="{name}" type="fixed"><parent link="{piece.name}"/><child link="{name}"/>'
        f'<origin xyz="{_numbers(*shape.origin)}" rpy="{_numbers(*shape.turn)}"/></joint>'
    )


def _geometry(shape: Shape) -> str:
    if shape.kind == "box":
        return f'<box size="{_numbers(*shape.size)}"/>'
    if shape.kind == "rod":
        return f'<cylinder radius="{shape.size[0]}" length="{shape.size[1]}"/>'
    if shape.kind == "ball":
        return f'<sphere radius="{shape.size[0]}"/>'
    return f'<mesh filename="{_BALL_MESH}" scale="{_numbers(*shape.size)}"/>'


def _joint(joint: Joint) -> str:
    return (
        f'<joint name="{joint.name}" type="revolute">'
        f'<parent link="{joint.parent}"/><child link="{joint.child}"/>'
        f'<origin xyz="{_numbers(*joint.origin)}"/><axis xyz="{_numbers(*joint.axis)}"/>'
        f'<limit lower="{joint.lower}" upper="{joint.upper}" '
        f'velocity="{joint.max_speed}" effort="{joint.max_torque}"/></joint>'
    )


def _numbers(*numbers: float) -> str:
    return " ".join(f"{number:.9g}" for number in numbers)


def _ball_mesh(rings: int = 14, spokes: int = 24) -> str:
    """Returns a ball of radius 1 as Wavefront OBJ."""
    points = [(0.0, 0.0, 1.0)]
    for ring in range(1, rings):
        across, up = math.sin(math.pi * ring / rings), math.cos(math.pi * ring / rings)
        for spoke in range(spokes):
            around = 2 * math.pi * spoke / spokes
            points.append((across * math.cos(around), across * math.sin(around), up))
    points.append((0.0, 0.0, -1.0))

    def number(ring: int, spoke: int) -> int:
        return 2 + (ring - 1) * spokes + spoke % spokes

    faces = [(1, number(1, s), number(1, s + 1)) for s in range(spokes)]
    for ring in range(1, rings - 1):
        for s in range(spokes):
            a, b = number(ring, s), number(ring, s + 1)
            c, d = number(ring + 1, s), number(ring + 1, s + 1)
            faces += [(a, c, d), (a, d, b)]
    last = len(points)
    faces += [(last, number(rings - 1, s + 1), number(rings - 1, s)) for s in range(spokes)]
    # On a unit ball the normals equal the points.
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in points]
    lines += [f"vn {x:.6f} {y:.6f} {z:.6f}" for x, y, z in points]
    lines += ["f " + " ".join(f"{p}//{p}" for p in face) for face in faces]
    return "\n".join([*lines, ""])
