"""Imports and opens PyBullet without output on the terminal, and looks up joints and frames."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from actors.robots.room.rotation import Vector
from actors.robots.room.silence import silenced

with silenced():
    # The import prints a build time.
    import pybullet
    from pybullet_utils.bullet_client import BulletClient


Quaternion = tuple[float, float, float, float]
"""A rotation: x, y, z, w."""
Pose = tuple[Vector, Quaternion]


def open_engine() -> Any:
    """Returns a new physics client without a display; PyBullet's functions are its methods."""
    with silenced():
        return BulletClient(pybullet.DIRECT)


def joints_of(engine: Any, body: int, *, hinges: bool = False) -> dict[str, int]:
    """Returns the numbers of a body's joints by name; a joint's child link has the same number.

    Args:
        hinges: whether to return only joints that turn.
    """
    infos = (engine.getJointInfo(body, joint) for joint in range(engine.getNumJoints(body)))
    return {i[1].decode(): i[0] for i in infos if not hinges or i[2] == engine.JOINT_REVOLUTE}


def angles_of(engine: Any, body: int) -> dict[str, float]:
    """Returns the present angle of each of a body's hinges by its name, rad."""
    hinges = joints_of(engine, body, hinges=True)
    return {name: engine.getJointState(body, joint)[0] for name, joint in hinges.items()}


def frame_of(engine: Any, body: int, link: int) -> Pose:
    """Returns the pose in the room of the frame of a link, or of the base (-1)."""
    if link >= 0:
        state = engine.getLinkState(body, link, computeForwardKinematics=1)
        return state[4], state[5]
    # The engine gives the pose of a base's centre of mass, not of its frame.
    inertial = engine.getDynamicsInfo(body, -1)[3:5]
    pose: Pose = engine.multiplyTransforms(
        *engine.getBasePositionAndOrientation(body), *engine.invertTransform(*inertial)
    )
    return pose


def fixed_body(engine: Any, file: Path, position: Sequence[float]) -> tuple[int, dict[str, int]]:
    """Returns a body that stands fixed at ``position``, m, and the numbers of its joints by name.

    The inertias in its URDF ``file`` are used as they are.
    """
    body: int = engine.loadURDF(
        str(file), position, useFixedBase=True, flags=engine.URDF_USE_INERTIA_FROM_FILE
    )
    return body, joints_of(engine, body)
