"""The room as shapes and poses, compared with the engine and with what they are written from."""

from collections.abc import Iterator

import numpy as np
import pytest

from actors.robots.nao.posture import TORSO_ORIGIN
from actors.robots.nao.robot import Nao
from actors.robots.robotroller.robot import Robotroller
from actors.robots.room.room import Room
from common.actions import Keys
from common.settings.conditions import CameraConfig


@pytest.fixture(params=[Nao, Robotroller], scope="module")
def room(request: pytest.FixtureRequest) -> Iterator[Room]:
    room: Room = request.param(camera=CameraConfig(yaw=5.0, screen_distance=1.1, screen_tilt=4.0))
    yield room
    room.close()


def test_every_drawn_shape_is_there(room: Room) -> None:
    engine = room._engine
    drawn = [d for body in range(engine.getNumBodies()) for d in engine.getVisualShapeData(body)]
    scene = room.scene()
    assert sum(map(len, scene.shapes.values())) == len(drawn) > 50
    assert scene.shapes.keys() == scene.poses().keys()
    desk = scene.shapes["room/desk"][0]
    assert desk.kind == "box"
    assert desk.size == pytest.approx((0.295, 0.56, 0.01))
    assert desk.origin == pytest.approx((0.2525, 0.0, 0.199))


def test_poses_are_those_of_the_frames(room: Room) -> None:
    scene = room.scene()
    before = scene.poses()
    assert before["room/desk"] == pytest.approx([0, 0, 0, 0, 0, 0, 1])
    away, tilt = room.furniture.screen_place
    assert (away > 0.05, tilt) == (True, 4.0)
    # The middle of the sheet's front stays where the projected picture's middle is.
    x, y, z, _, b, _, w = before["room/screen"]
    turn = 2 * np.arctan2(b, w)
    front = np.array([1.15, 0.0, 0.545])
    placed = [
        np.cos(turn) * front[0] + np.sin(turn) * front[2] + x,
        y,
        -np.sin(turn) * front[0] + np.cos(turn) * front[2] + z,
    ]
    assert placed == pytest.approx(room.furniture.picture_corners.mean(axis=0))
    room.command(Keys.UP)
    for _ in range(20):
        room.step_frame()
    moved = {name for name, pose in scene.poses().items() if not np.allclose(pose, before[name])}
    assert any(name.startswith("robot/") for name in moved)
    assert any(name.startswith("controller/") for name in moved)
    assert not any(name.startswith("room/") for name in moved)


def test_a_base_is_at_its_frame_not_at_its_centre_of_mass() -> None:
    room = Nao()
    assert room.scene().poses()["robot/torso"][:3] == pytest.approx(TORSO_ORIGIN)
    assert not np.allclose(
        room._engine.getBasePositionAndOrientation(room.arms.body)[0], TORSO_ORIGIN
    )
    arms = room.arms
    names = [joint.name for joint in (*arms.left.chain.joints, *arms.right.chain.joints)]
    states = room._engine.getJointStates(arms.body, [*arms.left.joints, *arms.right.joints])
    angles = [state[0] for state in states]
    assert room.scene().joints() == room.angles() == dict(zip(names, angles, strict=True))
    room.close()


def test_the_cameras_attitude_is_that_of_its_pixels(room: Room) -> None:
    camera = room.view_of_robot.camera
    point = camera.position + camera.attitude @ (0.1, 0.05, 1.0)
    focal = camera.width / 2 / np.tan(np.radians(60.97) / 2)
    seen = camera.project(point[None])[0]
    assert seen == pytest.approx((160 + 0.1 * focal, 119 + 0.05 * focal), abs=0.05)
