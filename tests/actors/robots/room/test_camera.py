"""NAO's camera: its reused picture always equals a new rendering."""

import numpy as np
import pytest

from actors.robots.nao.robot import Nao
from actors.robots.room.camera import Camera
from actors.robots.room.furniture import PICTURE_CORNERS, PICTURE_HEIGHT, PICTURE_WIDTH
from actors.robots.room.still_view import StillView
from common.actions import KEYS_OF_ACTION, Keys
from common.settings.conditions import PERFECT_CAMERA, CameraConfig


def assert_same_as_full(room: Nao) -> None:
    cached, full = room.view_of_robot.rendering(), room.view_of_robot.camera.render()
    assert np.array_equal(cached.rgb, full.rgb)
    assert np.array_equal(cached.bodies, full.bodies)


def raise_arm(room: Nao, pitch: float, roll: float) -> None:
    """Stretches the left arm out forwards, at rest."""
    for joint, angle in zip(room.arms.left.joints, (pitch, roll, 0.0, -0.1), strict=True):
        room._engine.resetJointState(room.body, joint, angle)


def test_playing_happens_out_of_view(room: Nao) -> None:
    room.rest()
    renderings = []
    for keys in KEYS_OF_ACTION:
        room.command(keys)
        for _ in range(4):
            room.step_frame()
        renderings.append(room.view_of_robot.rendering())
    assert all(each is renderings[0] for each in renderings)
    assert not np.isin(
        room.view_of_robot.camera.render().bodies, (room.body, room.controller.body)
    ).any()


@pytest.mark.parametrize("action", [0, 6, 17])
def test_cached_picture_while_playing(room: Nao, action: int) -> None:
    room.rest()
    room.view_of_robot.rendering()
    room.command(KEYS_OF_ACTION[action])
    for _ in range(3):
        room.step_frame()
    assert_same_as_full(room)


def test_cached_picture_with_an_arm_in_view(room: Nao) -> None:
    room.rest()
    empty = room.view_of_robot.rendering()
    for pitch, roll in ((-0.5, -0.3), (-0.5, -0.25), (-0.3, -0.3)):
        raise_arm(room, pitch, roll)
        assert (room.view_of_robot.rendering().bodies == room.body).any()
        assert_same_as_full(room)
    room.rest()
    assert_same_as_full(room)
    assert np.array_equal(room.view_of_robot.rendering().rgb, empty.rgb)


def test_a_still_arm_in_view_is_rendered_once(room: Nao) -> None:
    raise_arm(room, -0.5, -0.3)
    rendering = room.view_of_robot.rendering()
    assert room.view_of_robot.rendering() is rendering
    raise_arm(room, -0.5, -0.299)
    assert room.view_of_robot.rendering() is not rendering
    room.rest()


def test_may_see_has_no_false_negatives(room: Nao) -> None:
    """Whenever a pixel of the robot is drawn in a random pose, `may_see` is true."""
    view = room.view_of_robot
    rng = np.random.default_rng(0)
    seen = 0
    for _ in range(8):
        raise_arm(room, float(rng.uniform(-1.0, 0.3)), float(rng.uniform(-0.31, 0.2)))
        drawn = bool((view.camera.render().bodies == room.body).any())
        seen += drawn
        if drawn:
            assert view._scene() != "nothing that moves"
    assert seen > 0
    room.rest()


def camera_at_the_origin(room: Nao) -> Camera:
    """Returns one that looks along x; its view ends where y = ±x and z = ±x."""
    ahead, up = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    return Camera(room._engine, np.zeros(3), ahead, up, size=(64, 64), angles=(90.0, 90.0))


@pytest.mark.parametrize("beyond", [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
def test_a_ball_may_be_seen_if_it_reaches_into_the_view(
    room: Nao, beyond: tuple[float, float]
) -> None:
    """A point that is d beyond the edge, along y or z, is d / √2 from the edge's plane."""
    camera = camera_at_the_origin(room)
    for distance, seen in ((0.14, True), (0.143, False)):  # 0.09899 and 0.10112
        y, z = (side * (1.0 + distance) for side in beyond)
        assert camera.may_see([(1.0, y, z)], [0.1]) is seen


def test_what_reaches_behind_the_camera_may_be_anywhere_in_the_picture(room: Nao) -> None:
    camera = camera_at_the_origin(room)
    before, behind = (1.0, 0.1, 0.1), (-1.0, 0.1, 0.1)
    assert camera.window_of(np.array([before, behind])) == camera.whole
    assert camera.window_of(np.array([before])) != camera.whole


def test_a_still_view_of_the_keys_shows_their_colours(room: Nao) -> None:
    room.rest()
    camera = room.viewpoints["hands"].camera(room._engine, 160, 120)
    view = StillView(room._engine, camera, room._moves, room._appearance)
    for keys in (Keys.NONE, Keys.FIRE, Keys.NONE):
        room.command(keys)
        assert [room.step_frame() for _ in range(8)][-1] == keys
        red, green, blue = np.moveaxis(view.rendering().rgb.astype(int), 2, 0)
        bright = (green > red + 60) & (green > blue + 60)
        assert bright.any() == (keys == Keys.FIRE)


def test_projected_corners_are_where_the_renderer_draws(room: Nao) -> None:
    """Centre and area of the screen's pixels match those of its projected outline.

    A level edge may lie anywhere between two rows of pixels; over many poses that evens out.
    """
    rng = np.random.default_rng(0)
    misses = []
    for _ in range(12):
        yaw, pitch = rng.uniform(-8, 8, 2)
        room.set_eye(
            CameraConfig(
                yaw=yaw,
                pitch=pitch,
                screen_distance=rng.uniform(0.9, 1.1),
                screen_tilt=rng.uniform(-6, 6),
            )
        )
        camera, corners = room.view_of_robot.camera, room.furniture.picture_corners
        rows, columns = np.nonzero(camera.render().bodies == room.furniture.screen)
        middle = corners.mean(axis=0)
        margin = 1.0 + np.array([0.0, 0.06 / PICTURE_WIDTH, 0.06 / PICTURE_HEIGHT])
        outline = camera.project(middle + (corners - middle) * margin)
        x, y = outline[:, 0], outline[:, 1]
        # Area and middle of a polygon by its edges (the shoelace formula).
        cross = x * np.roll(y, -1) - np.roll(x, -1) * y
        area = cross.sum() / 2
        middle_x = ((x + np.roll(x, -1)) * cross).sum() / (6 * area)
        middle_y = ((y + np.roll(y, -1)) * cross).sum() / (6 * area)
        misses.append((columns.mean() - middle_x, rows.mean() - middle_y))
        assert len(rows) == pytest.approx(abs(area), rel=0.02)
    room.set_eye(PERFECT_CAMERA)
    assert np.abs(misses).max() < 0.5
    assert np.abs(np.mean(misses, axis=0)).max() < 0.1


def test_the_whole_picture_is_in_view(room: Nao) -> None:
    x, y = room.view_of_robot.camera.project(PICTURE_CORNERS).T
    assert (x > 5).all()
    assert (x < 314).all()
    assert (y > 5).all()
    assert (y < 234).all()
