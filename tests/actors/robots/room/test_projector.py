"""The projected picture against rays through every pixel, and occlusion."""

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.robots.nao.robot import Nao
from actors.robots.room.camera import Rendering
from actors.robots.room.furniture import PICTURE_CORNERS
from actors.robots.room.projector import Projection
from actors.vision.layout import BORDER
from common.settings.conditions import PERFECT_CAMERA, CameraConfig

ROWS, COLUMNS = 210, 160


@pytest.fixture(scope="module")
def projection(room: Nao) -> Projection:
    camera = room.view_of_robot.camera
    return Projection(camera, PICTURE_CORNERS, room.furniture.screen, (ROWS, COLUMNS))


def smooth_game() -> NDArray[np.uint8]:
    """Returns slow waves, on which the exact place of a sample matters little."""
    y, x = np.mgrid[:ROWS, :COLUMNS]
    waves = [np.sin(x / 23), np.cos(y / 31), np.sin((x + y) / 37)]
    return np.stack([150 + 90 * wave for wave in waves], axis=2).astype(np.uint8)


def reference(room: Nao, game: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Returns the picture by intersecting each pixel's ray with the screen's plane; NaN beside it.

    Between two and three of the game's rows fall on one of the camera's, so the picture is drawn
    from the means of pairs of rows.
    """
    pairs = game.reshape(ROWS // 2, 2, COLUMNS, 3).mean(axis=1)
    camera = room.view_of_robot.camera
    image = np.full((camera.height, camera.width, 3), np.nan)
    left_top, right_top, _, left_bottom = PICTURE_CORNERS
    across, down = right_top - left_top, left_bottom - left_top
    normal = np.cross(across, down)
    back = np.linalg.inv(camera._to_clip)
    for row in range(camera.height):
        for column in range(camera.width):
            x, y = 2 * column / camera.width - 1, 1 - 2 * (row + 1) / camera.height
            ends = [back @ [x, y, depth, 1] for depth in (-1, 1)]
            near, far = (end[:3] / end[3] for end in ends)
            along = far - near
            point = near + along * (normal @ (left_top - near)) / (normal @ along)
            u = (point - left_top) @ across / (across @ across)
            v = (point - left_top) @ down / (down @ down)
            if not (0 <= u <= 1 and 0 <= v <= 1):
                continue
            game_x = (u * (1 + 2 * BORDER) - BORDER) * COLUMNS - 0.5
            game_y = (v * (1 + 2 * BORDER) - BORDER) * len(pairs) - 0.5
            image[row, column] = bilinear(pairs, game_x, game_y)
    return image


def bilinear(game: NDArray[np.float64], x: float, y: float) -> NDArray[np.float64]:
    total = np.zeros(3)
    left, top = int(np.floor(x)), int(np.floor(y))
    for row in (top, top + 1):
        for column in (left, left + 1):
            if 0 <= row < len(game) and 0 <= column < COLUMNS:
                total += game[row, column] * (1 - abs(x - column)) * (1 - abs(y - row))
    return total


def test_picture_equals_ray_casting(room: Nao, projection: Projection) -> None:
    game = smooth_game()
    rendering = room.view_of_robot.rendering()
    drawn = projection.draw(rendering, game)
    expected = reference(room, game)
    on_picture = ~np.isnan(expected[:, :, 0])
    # Pixels partly on the picture are blended with the screen around it.
    inner = on_picture.copy()
    for axis in (0, 1):
        for shift in (1, -1):
            inner &= np.roll(on_picture, shift, axis)
    assert inner.sum() > 10_000
    # OpenCV's fixed-point maps are exact to 1/32 pixel: at the game's own edge, where it falls to
    # black, that is up to 8 grey levels.
    difference = np.abs(drawn[inner] - expected[inner])
    assert difference.max() <= 8.5
    assert difference.mean() < 0.5
    outside = ~on_picture
    for down in (-1, 0, 1):
        for across in (-1, 0, 1):
            outside &= ~np.roll(on_picture, (down, across), (0, 1))
    assert np.array_equal(drawn[outside], rendering.rgb[outside])


def test_an_object_in_front_hides_the_picture(room: Nao, projection: Projection) -> None:
    rendering = room.view_of_robot.rendering()
    bodies = rendering.bodies.copy()
    bodies[100:140, 60:200] = room.body
    drawn = projection.draw(Rendering(rendering.rgb, bodies), smooth_game())
    assert np.array_equal(drawn[100:140, 60:200], rendering.rgb[100:140, 60:200])
    free = projection.draw(rendering, smooth_game())
    free[100:140, 60:200] = drawn[100:140, 60:200]
    assert np.array_equal(drawn, free)


def test_each_frame_is_drawn_afresh(room: Nao, projection: Projection) -> None:
    rendering = room.view_of_robot.rendering()
    before = rendering.rgb.copy()
    white = projection.draw(rendering, np.full((ROWS, COLUMNS, 3), 255, np.uint8))
    kept = white.copy()
    black = projection.draw(rendering, np.zeros((ROWS, COLUMNS, 3), np.uint8))
    assert np.array_equal(white, kept)
    assert np.array_equal(rendering.rgb, before)
    assert white[120, 160].tolist() == [255, 255, 255]
    assert black[120, 160].tolist() == [0, 0, 0]


@pytest.mark.parametrize(("yaw", "pitch"), [(45, 0), (-45, 0), (0, 45), (0, -45), (45, -45)])
def test_a_camera_may_look_past_the_screen(room: Nao, yaw: float, pitch: float) -> None:
    game = np.full((ROWS, COLUMNS, 3), 255, np.uint8)
    try:
        room.set_eye(CameraConfig(yaw=yaw, pitch=pitch))
        bare = room.view_of_robot.camera.render().rgb
        assert np.array_equal(room.picture(game), bare)
        room.set_eye(CameraConfig(yaw=yaw, pitch=pitch, distortion=0.02, blur=2, glare=0.5))
        first = room.camera_picture(game)
        assert first.shape == bare.shape
        assert np.array_equal(room.camera_picture(game), first)
    finally:
        room.set_eye(PERFECT_CAMERA)
