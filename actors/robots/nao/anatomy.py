"""NAO's published kinematics, joint limits, speeds, torques and masses (H25, V5 and V6).

Units: m, rad, kg, N·m and rad/s. Axes: x forward, y left, z up. This module has published values
only; `shapes` has the robot's appearance and `posture` how it sits.
"""

from dataclasses import dataclass, replace

from actors.robots.room.rotation import Vector
from actors.robots.room.urdf import Joint

X_AXIS: Vector = (1.0, 0.0, 0.0)
Y_AXIS: Vector = (0.0, 1.0, 0.0)
Z_AXIS: Vector = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Link:
    """A rigid part; ``inertia`` is (ixx, iyy, izz) about the centre of mass, in kg·m²."""

    name: str
    mass: float
    centre: Vector
    inertia: Vector


_HIP_YAW_PITCH: Vector = (0.0, 0.70710678, -0.70710678)
_AXES = {"x": X_AXIS, "y": Y_AXIS, "z": Z_AXIS, "y-z": _HIP_YAW_PITCH}

# Chains from the torso, in which each joint's parent is the child of the one before.
# name         child       x        y      z      axis  lower      upper      speed    torque
_HEAD = """
HeadYaw        neck        0        0      0.1265 z    -2.08567    2.08567    8.26797  1.547
HeadPitch      head        0        0      0      y    -0.671952   0.514872   7.19407  1.532
"""
_ARM = """
LShoulderPitch l_shoulder  0        0.098  0.1    y    -2.08567    2.08567    8.26797  1.329
LShoulderRoll  l_biceps    0        0      0      z    -0.314159   1.32645    7.19407  1.7835
LElbowYaw      l_elbow     0.105    0.015  0      x    -2.08567    2.08567    8.26797  1.547
LElbowRoll     l_forearm   0        0      0      z    -1.54462   -0.0349066  7.19407  1.532
LWristYaw      l_hand      0.05595  0      0      x    -1.82387    1.82387    24.6229  0.4075
"""
_LEG = """
LHipYawPitch   l_pelvis    0        0.05  -0.085  y-z  -1.14529    0.740718   4.16174  3.348
LHipPitch      l_thigh     0        0      0      y    -1.53589    0.48398    6.40239  3.023
LKneePitch     l_shin      0        0     -0.1    y    -0.0923279  2.11255    6.40239  3.023
LAnklePitch    l_foot      0        0     -0.1029 y    -1.18944    0.922581   6.40239  3.023
"""


def _joints(table: str) -> list[Joint]:
    joints: list[Joint] = []
    for row in table.strip().splitlines():
        name, child, x, y, z, axis, *bounds = row.split()
        parent = joints[-1].child if joints else "torso"
        origin = (float(x), float(y), float(z))
        lower, upper, speed, torque = map(float, bounds)
        joint = Joint(name, parent, child, origin, _AXES[axis], lower, upper, speed, torque)
        joints.append(joint)
    return joints


_MIDDLE_LINKS = (
    Link("torso", 1.04956, (-0.00413, 0.0, 0.04342), (3.08e-3, 2.88e-3, 1.59e-3)),
    Link("neck", 0.07842, (0.0, 0.0, -0.02742), (1.6e-5, 1.7e-5, 5.5e-6)),
    Link("head", 0.60533, (-0.00112, 0.0, 0.05258), (9.58e-4, 8.17e-4, 9.85e-4)),
)

_LEFT_ARM_LINKS = (
    Link("l_shoulder", 0.09304, (-0.00165, -0.02663, 0.00014), (1.83e-5, 1.39e-5, 2.02e-5)),
    Link("l_biceps", 0.15777, (0.02455, 0.00563, 0.0033), (8.72e-5, 2.75e-4, 2.42e-4)),
    Link("l_elbow", 0.06483, (-0.02744, 0.0, -0.00014), (5.6e-6, 2.66e-5, 2.76e-5)),
    Link("l_forearm", 0.07761, (0.02556, 0.00281, 0.00076), (2.47e-5, 3.84e-5, 3.6e-5)),
    Link("l_hand", 0.18533, (0.03434, -0.00088, 0.00308), (6.86e-5, 1.36e-4, 1.33e-4)),
)

# The legs never move, so these values do not affect play. They are approximate: with them the
# whole robot has about its real mass, 5.3 kg.
_LEFT_LEG_LINKS = (
    Link("l_pelvis", 0.21034, (-0.0076, 0.0, 0.011), (1.0e-4, 1.0e-4, 1.0e-4)),
    Link("l_thigh", 0.38968, (0.0014, 0.0, -0.0537), (1.64e-3, 1.59e-3, 3.0e-4)),
    Link("l_shin", 0.29142, (0.0045, 0.0, -0.0494), (1.18e-3, 1.13e-3, 1.9e-4)),
    Link("l_foot", 0.296, (0.0166, 0.0, -0.0284), (3.0e-4, 7.0e-4, 7.5e-4)),
)

TOP_CAMERA_ORIGIN: Vector = (0.05871, 0.0, 0.06364)
"""Position of the top camera in the head's frame."""
TOP_CAMERA_PITCH = 0.0209
"""Downward pitch of the top camera relative to the head."""
SOLE_BELOW_ANKLE = 0.04511


def _mirrored_name(name: str) -> str:
    if name.startswith("l_"):
        return "r_" + name[2:]
    return "R" + name[1:] if name.startswith("L") else name


def _mirrored_vector(vector: Vector) -> Vector:
    return (vector[0], -vector[1], vector[2])


def _mirrored_joint(joint: Joint) -> Joint:
    """Returns the right side's counterpart of ``joint``, mirrored in y.

    Rotation about x or z changes its sign, rotation about y does not. One motor turns both hips.
    """
    turned = joint.axis in (X_AXIS, Z_AXIS)
    return replace(
        joint,
        name=_mirrored_name(joint.name),
        parent=_mirrored_name(joint.parent),
        child=_mirrored_name(joint.child),
        origin=_mirrored_vector(joint.origin),
        axis=(0.0, 0.70710678, 0.70710678) if joint.axis == _HIP_YAW_PITCH else joint.axis,
        lower=-joint.upper if turned else joint.lower,
        upper=-joint.lower if turned else joint.upper,
    )


def _mirrored_link(link: Link) -> Link:
    return replace(link, name=_mirrored_name(link.name), centre=_mirrored_vector(link.centre))


def _right_arm_joint(joint: Joint) -> Joint:
    mirrored = _mirrored_joint(joint)
    # The manufacturer gives only this value differently for the right arm.
    return replace(mirrored, max_torque=1.783) if mirrored.name == "RShoulderRoll" else mirrored


JOINTS: tuple[Joint, ...] = (
    *_joints(_HEAD),
    *_joints(_ARM),
    *map(_right_arm_joint, _joints(_ARM)),
    *_joints(_LEG),
    *map(_mirrored_joint, _joints(_LEG)),
)
"""All joints, parents before children."""

LINKS: tuple[Link, ...] = (
    *_MIDDLE_LINKS,
    *_LEFT_ARM_LINKS,
    *map(_mirrored_link, _LEFT_ARM_LINKS),
    *_LEFT_LEG_LINKS,
    *map(_mirrored_link, _LEFT_LEG_LINKS),
)

JOINT_NAMED = {joint.name: joint for joint in JOINTS}
LINK_NAMED = {link.name: link for link in LINKS}
