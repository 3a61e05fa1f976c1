"""Assembly of the body: links between held joints are joined into one rigid piece.

PyBullet 3.2.7 can merge fixed links itself, but it misplaces the merged centre of mass and prints
a line per link. This module joins masses, centres and inertias by the parallel axis theorem, so
that the moving arms have exactly the mass and inertia of the published parts.
"""

import shutil
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pybullet_data
from numpy.typing import NDArray

from actors.robots.nao.anatomy import JOINT_NAMED, JOINTS, LINK_NAMED, Link
from actors.robots.nao.posture import HELD_ANGLES
from actors.robots.nao.shapes import SHAPES
from actors.robots.room.rotation import about, from_roll_pitch_yaw, to_roll_pitch_yaw
from actors.robots.room.urdf import BALL_MESH, Joint, Part, write_urdf


@dataclass
class Piece(Part):
    """Links that move as one rigid body, in the frame of the first link."""

    def add(self, link: Link, turn: NDArray[np.float64], origin: NDArray[np.float64]) -> None:
        """Joins ``link``; its frame has rotation ``turn`` and position ``origin`` in this piece."""
        centre = origin + turn @ np.array(link.centre)
        self.join(link.mass, centre, turn @ np.diag(link.inertia) @ turn.T)
        for shape in SHAPES[link.name]:
            x, y, z = origin + turn @ np.array(shape.origin)
            self.shapes.append(
                replace(
                    shape,
                    origin=(float(x), float(y), float(z)),
                    turn=to_roll_pitch_yaw(turn @ from_roll_pitch_yaw(shape.turn)),
                )
            )


_JOINT_ABOVE = {joint.child: joint for joint in JOINTS}


def place_in_piece(link_name: str) -> tuple[str, NDArray[np.float64], NDArray[np.float64]]:
    """Returns the name of a link's piece, and the link's rotation and position in its frame."""
    turn, origin = np.eye(3), np.zeros(3)
    while (joint := _JOINT_ABOVE.get(link_name)) is not None and joint.name in HELD_ANGLES:
        held = about(joint.axis, HELD_ANGLES[joint.name])
        turn, origin = held @ turn, np.array(joint.origin) + held @ origin
        link_name = joint.parent
    return link_name, turn, origin


@cache
def assemble() -> tuple[dict[str, Piece], list[Joint]]:
    """Returns the pieces by name, the torso's first, and the moving joints between them.

    Do not change them: all robots of a process share them.
    """
    pieces: dict[str, Piece] = {}
    for link in LINK_NAMED.values():
        name, turn, origin = place_in_piece(link.name)
        pieces.setdefault(name, Piece(name)).add(link, turn, origin)
    moving = [joint for joint in JOINT_NAMED.values() if joint.name not in HELD_ANGLES]
    # Each joint must be attached to the first link of its piece; NAO's all are.
    assert all(joint.parent in pieces for joint in moving)
    return pieces, moving


def write_nao(folder: Path) -> Path:
    """Writes the robot's URDF and the mesh of its eggs into ``folder``; returns the URDF's path.

    Its base is the torso. It has only moving joints, so that a physics step costs a fortieth of the
    whole robot's.
    """
    shutil.copy(Path(pybullet_data.getDataPath()) / "sphere_smooth.obj", folder / BALL_MESH)
    pieces, joints = assemble()
    return write_urdf(folder, "nao", pieces.values(), joints)
