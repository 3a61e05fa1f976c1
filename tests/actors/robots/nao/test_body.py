"""The robot in the engine has the published joints and masses."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.robots.nao.anatomy import (
    JOINT_NAMED,
    JOINTS,
    LINK_NAMED,
    LINKS,
    SOLE_BELOW_ANKLE,
    TOP_CAMERA_ORIGIN,
    TOP_CAMERA_PITCH,
)
from actors.robots.nao.assembly import assemble
from actors.robots.nao.posture import ARM_JOINTS, HELD_ANGLES, TORSO_ORIGIN
from actors.robots.nao.robot import Nao
from actors.robots.nao.shapes import SHAPES
from actors.robots.room.rotation import about, from_roll_pitch_yaw, to_roll_pitch_yaw
from actors.vision.field_of_view import HEIGHT_ANGLE, WIDTH_ANGLE

# From the maker's tables: lower, upper, speed, torque.
PUBLISHED = {
    "LShoulderPitch": (-2.08567, 2.08567, 8.26797, 1.329),
    "LShoulderRoll": (-0.314159, 1.32645, 7.19407, 1.7835),
    "LElbowYaw": (-2.08567, 2.08567, 8.26797, 1.547),
    "LElbowRoll": (-1.54462, -0.0349066, 7.19407, 1.532),
    "RShoulderPitch": (-2.08567, 2.08567, 8.26797, 1.329),
    "RShoulderRoll": (-1.32645, 0.314159, 7.19407, 1.783),
    "RElbowYaw": (-2.08567, 2.08567, 8.26797, 1.547),
    "RElbowRoll": (0.0349066, 1.54462, 7.19407, 1.532),
}

# Joint, axis, parent, place in the parent, lower, upper, speed, torque; the left side's, and where
# the right side's limits and torque are published on their own, those.
JOINT_TABLE = """
HeadYaw        z  torso      0 0 0.1265       -2.08567    2.08567    8.26797  1.547
HeadPitch      y  neck       0 0 0            -0.671952   0.514872   7.19407  1.532
LShoulderPitch y  torso      0 0.098 0.1      -2.08567    2.08567    8.26797  1.329
LShoulderRoll  z  l_shoulder 0 0 0            -0.314159   1.32645    7.19407  1.7835
LElbowYaw      x  l_biceps   0.105 0.015 0    -2.08567    2.08567    8.26797  1.547
LElbowRoll     z  l_elbow    0 0 0            -1.54462   -0.0349066  7.19407  1.532
LWristYaw      x  l_forearm  0.05595 0 0      -1.82387    1.82387   24.6229   0.4075
RShoulderPitch y  torso      0 -0.098 0.1     -2.08567    2.08567    8.26797  1.329
RShoulderRoll  z  r_shoulder 0 0 0            -1.32645    0.314159   7.19407  1.783
RElbowYaw      x  r_biceps   0.105 -0.015 0   -2.08567    2.08567    8.26797  1.547
RElbowRoll     z  r_elbow    0 0 0             0.0349066  1.54462    7.19407  1.532
RWristYaw      x  r_forearm  0.05595 0 0      -1.82387    1.82387   24.6229   0.4075
LHipYawPitch   -  torso      0 0.05 -0.085    -1.14529    0.740718   4.16174  3.348
LHipPitch      y  l_pelvis   0 0 0            -1.53589    0.48398    6.40239  3.023
LKneePitch     y  l_thigh    0 0 -0.1         -0.0923279  2.11255    6.40239  3.023
LAnklePitch    y  l_shin     0 0 -0.1029      -1.18944    0.922581   6.40239  3.023
RHipYawPitch   -  torso      0 -0.05 -0.085   -1.14529    0.740718   4.16174  3.348
RHipPitch      y  r_pelvis   0 0 0            -1.53589    0.48398    6.40239  3.023
RKneePitch     y  r_thigh    0 0 -0.1         -0.0923279  2.11255    6.40239  3.023
RAnklePitch    y  r_shin     0 0 -0.1029      -1.18944    0.922581   6.40239  3.023
"""
# Link, mass, centre of mass, ixx iyy izz.
LINK_TABLE = """
torso       1.04956  -0.00413  0       0.04342   3.08e-3 2.88e-3 1.59e-3
neck        0.07842   0        0      -0.02742   1.6e-5  1.7e-5  5.5e-6
head        0.60533  -0.00112  0       0.05258   9.58e-4 8.17e-4 9.85e-4
l_shoulder  0.09304  -0.00165 -0.02663 0.00014   1.83e-5 1.39e-5 2.02e-5
r_shoulder  0.09304  -0.00165  0.02663 0.00014   1.83e-5 1.39e-5 2.02e-5
l_biceps    0.15777   0.02455  0.00563 0.0033    8.72e-5 2.75e-4 2.42e-4
r_biceps    0.15777   0.02455 -0.00563 0.0033    8.72e-5 2.75e-4 2.42e-4
l_elbow     0.06483  -0.02744  0      -0.00014   5.6e-6  2.66e-5 2.76e-5
r_elbow     0.06483  -0.02744  0      -0.00014   5.6e-6  2.66e-5 2.76e-5
l_forearm   0.07761   0.02556  0.00281 0.00076   2.47e-5 3.84e-5 3.6e-5
r_forearm   0.07761   0.02556 -0.00281 0.00076   2.47e-5 3.84e-5 3.6e-5
l_hand      0.18533   0.03434 -0.00088 0.00308   6.86e-5 1.36e-4 1.33e-4
r_hand      0.18533   0.03434  0.00088 0.00308   6.86e-5 1.36e-4 1.33e-4
"""
AXES = {
    "x": (1, 0, 0),
    "y": (0, 1, 0),
    "z": (0, 0, 1),
}
HIP = math.sqrt(0.5)
HIP_AXES = {"LHipYawPitch": (0, HIP, -HIP), "RHipYawPitch": (0, HIP, HIP)}


def test_every_joint_is_as_published() -> None:
    rows = [line.split() for line in JOINT_TABLE.strip().splitlines()]
    assert [row[0] for row in rows] == [joint.name for joint in JOINTS]
    for name, axis, parent, *figures in rows:
        joint = JOINT_NAMED[name]
        assert joint.parent == parent
        assert joint.axis == pytest.approx(HIP_AXES.get(name) or AXES[axis], abs=1e-6), name
        found = (*joint.origin, joint.lower, joint.upper, joint.max_speed, joint.max_torque)
        assert found == tuple(map(float, figures)), name


def test_every_link_of_the_upper_body_is_as_published() -> None:
    rows = [line.split() for line in LINK_TABLE.strip().splitlines()]
    for name, *figures in rows:
        link = LINK_NAMED[name]
        assert (link.mass, *link.centre, *link.inertia) == tuple(map(float, figures)), name
    legs = {link.name for link in LINKS} - {row[0] for row in rows}
    assert {name[2:] for name in legs} == {"pelvis", "thigh", "shin", "foot"}
    assert sum(link.mass for link in LINKS) == pytest.approx(5.3, abs=0.1)


def test_the_camera_and_the_sole_are_where_they_are_published() -> None:
    assert TOP_CAMERA_ORIGIN == (0.05871, 0.0, 0.06364)
    assert (TOP_CAMERA_PITCH, SOLE_BELOW_ANKLE) == (0.0209, 0.04511)
    assert (WIDTH_ANGLE, HEIGHT_ANGLE) == (60.97, 47.64)


def test_exactly_the_arm_joints_move_with_the_published_limits(room: Nao) -> None:
    engine = room._engine
    found = {}
    for joint in range(engine.getNumJoints(room.body)):
        info = engine.getJointInfo(room.body, joint)
        if info[2] == engine.JOINT_FIXED:
            continue
        assert info[2] == engine.JOINT_REVOLUTE
        found[info[1].decode()] = (info[8], info[9], info[11], info[10])
    assert set(found) == {side + name for side in "LR" for name in ARM_JOINTS} == set(PUBLISHED)
    for name, figures in PUBLISHED.items():
        assert found[name] == pytest.approx(figures), name


def test_arm_parts_weigh_what_the_published_parts_weigh(room: Nao) -> None:
    engine = room._engine
    masses, centres = {}, {}
    for link in range(engine.getNumJoints(room.body)):
        name = engine.getJointInfo(room.body, link)[12].decode()
        dynamics = engine.getDynamicsInfo(room.body, link)
        masses[name], centres[name] = dynamics[0], dynamics[3]
    for side in "lr":
        assert masses[f"{side}_shoulder"] == pytest.approx(0.09304)
        assert masses[f"{side}_biceps"] == pytest.approx(0.15777)
        assert masses[f"{side}_elbow"] == pytest.approx(0.06483)
        # Forearm, and wrist and hand, which do not move against each other.
        assert masses[f"{side}_forearm"] == pytest.approx(0.07761 + 0.18533)
        along = (0.07761 * 0.02556 + 0.18533 * (0.05595 + 0.03434)) / (0.07761 + 0.18533)
        assert centres[f"{side}_forearm"][0] == pytest.approx(along, abs=1e-6)


def test_only_fingertips_touch_and_weigh_nothing_of_their_own(room: Nao) -> None:
    engine = room._engine
    touching = [
        link
        for link in range(engine.getNumJoints(room.body))
        if engine.getCollisionShapeData(room.body, link)
    ]
    assert len(touching) == 2
    for link in touching:
        assert engine.getDynamicsInfo(room.body, link)[0] < 1e-5
    # Where the inverse kinematics has them.
    for link, arm in zip(touching, (room.arms.left, room.arms.right), strict=True):
        angles = [state[0] for state in engine.getJointStates(room.body, arm.joints)]
        place = engine.getLinkState(room.body, link, computeForwardKinematics=1)[4]
        assert place == pytest.approx(arm.chain.fingertip(np.array(angles)), abs=1e-6)


def test_the_whole_body_keeps_its_mass_and_every_link_has_a_shape() -> None:
    pieces, moving = assemble()
    assert sum(piece.mass for piece in pieces.values()) == pytest.approx(
        sum(link.mass for link in LINKS)
    )
    assert len(pieces) == len(moving) + 1
    assert set(SHAPES) == set(LINK_NAMED)


def test_joined_inertia_is_that_of_its_points() -> None:
    """A piece of two links matches a cloud of point masses with the links' moments."""
    piece = assemble()[0]["l_forearm"]
    masses, points = [], []
    wrist = about((1, 0, 0), HELD_ANGLES["LWristYaw"])
    for name, turn, origin in (
        ("l_forearm", np.eye(3), np.zeros(3)),
        ("l_hand", wrist, np.array([0.05595, 0.0, 0.0])),
    ):
        link = LINK_NAMED[name]
        # Six points on the axes with the same second moments as the link.
        second = np.sum(link.inertia) / 2 - np.array(link.inertia)
        for axis in range(3):
            for sign in (1, -1):
                offset = np.zeros(3)
                offset[axis] = sign * math.sqrt(3 * second[axis] / link.mass)
                masses.append(link.mass / 6)
                points.append(origin + turn @ (np.array(link.centre) + offset))
    weights, cloud = np.array(masses), np.array(points)
    centre = weights @ cloud / weights.sum()
    around = cloud - centre
    inertia = sum(
        m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(weights, around, strict=True)
    )
    assert piece.centre == pytest.approx(centre, abs=1e-9)
    assert piece.inertia == pytest.approx(inertia, abs=1e-9)


def test_the_right_side_mirrors_the_left() -> None:
    for joint in JOINTS:
        if not joint.name.startswith("L"):
            continue
        twin = JOINT_NAMED["R" + joint.name[1:]]
        x, y, z = joint.origin
        assert twin.origin == (x, -y, z)
        assert twin.upper - twin.lower == pytest.approx(joint.upper - joint.lower)


def test_held_joints_are_within_their_limits() -> None:
    for name, angle in HELD_ANGLES.items():
        assert JOINT_NAMED[name].lower <= angle <= JOINT_NAMED[name].upper


def test_it_sits_with_its_soles_on_the_floor() -> None:
    """The lengths of torso, thigh, shin and sole add up to the torso's height."""
    tilt = HELD_ANGLES["LKneePitch"]
    assert HELD_ANGLES["LHipPitch"] == -tilt
    height = TORSO_ORIGIN[2] - 0.085 - 0.1 * math.cos(tilt) - 0.1029 - 0.04511
    assert height == pytest.approx(0.0, abs=1e-9)


angle = st.floats(-math.pi, math.pi)


@given(angle, angle, angle)
def test_roll_pitch_yaw_survives_the_round_trip(roll: float, pitch: float, yaw: float) -> None:
    matrix = from_roll_pitch_yaw((roll, pitch, yaw))
    assert from_roll_pitch_yaw(to_roll_pitch_yaw(matrix)) == pytest.approx(matrix, abs=1e-6)
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-9)


def test_a_quarter_turn_about_z_turns_x_to_y() -> None:
    assert about((0, 0, 1), math.pi / 2) @ [1, 0, 0] == pytest.approx([0, 1, 0])
