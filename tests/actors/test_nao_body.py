"""The robot in the engine has the published joints and masses."""

import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.nao.anatomy import JOINT_NAMED, JOINTS, LINK_NAMED, LINKS
from actors.nao.assembly import assemble
from actors.nao.posture import ARM_JOINTS, HELD_ANGLES, TORSO_ORIGIN
from actors.nao.room import Room
from actors.nao.rotation import about, from_roll_pitch_yaw, to_roll_pitch_yaw
from actors.nao.shapes import SHAPES

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


@pytest.fixture(scope="module")
def room() -> Iterator[Room]:
    room = Room()
    yield room
    room.close()


def test_exactly_the_arm_joints_move_with_the_published_limits(room: Room) -> None:
    engine = room._engine
    found = {}
    for joint in range(engine.getNumJoints(room.body)):
        info = engine.getJointInfo(room.body, joint)
        assert info[2] == engine.JOINT_REVOLUTE
        found[info[1].decode()] = (info[8], info[9], info[11], info[10])
    assert set(found) == {side + name for side in "LR" for name in ARM_JOINTS} == set(PUBLISHED)
    for name, figures in PUBLISHED.items():
        assert found[name] == pytest.approx(figures), name


def test_arm_parts_weigh_what_the_published_parts_weigh(room: Room) -> None:
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


def test_the_whole_body_keeps_its_mass_and_every_link_has_a_look() -> None:
    pieces, moving = assemble()
    assert sum(piece.mass for piece in pieces.values()) == pytest.approx(
        sum(link.mass for link in LINKS)
    )
    assert len(pieces) == len(moving) + 1
    assert set(SHAPES) == set(LINK_NAMED)


def test_joined_inertia_is_that_of_its_points() -> None:
    """Against a cloud of point masses with the two links' moments."""
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
    """Torso, thigh, shin and sole, added up by hand."""
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
