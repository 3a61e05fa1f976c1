"""NAO's URDF, written from the assembled body.

It has moving joints only: a physics step then costs a fortieth of the whole robot's.
"""

import shutil
from pathlib import Path

import pybullet_data

from actors.robots.nao.assembly import assemble
from actors.robots.room.urdf import BALL_MESH, urdf


def write_urdf(folder: Path) -> Path:
    """Write the robot's URDF, whose base is the torso, and the mesh of its eggs into ``folder``;
    returns the URDF's path."""
    shutil.copy(Path(pybullet_data.getDataPath()) / "sphere_smooth.obj", folder / BALL_MESH)
    pieces, joints = assemble()
    path = folder / "nao.urdf"
    path.write_text(urdf("nao", pieces.values(), joints))
    return path
