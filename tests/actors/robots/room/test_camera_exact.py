"""The robot's picture, made with all optimisations, against a full rendering and plain projection.

The projection here is written independently from the geometry: pixel by pixel over the whole
picture, from the screen's four corners, without windows, caches or OpenCV.
"""

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.envs.emulator import Emulator
from actors.robots.nao.robot import Nao
from actors.vision.layout import BORDER
from common.actions import KEYS_OF_ACTION
from common.settings.conditions import PERFECT_CAMERA, CameraConfig

ROWS, COLUMNS = 210, 160
FINER = 8
"""Samples per pixel and axis for blending the picture's outer edge."""


def to_unit_square(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the homography ``[3, 3]`` from pixels to the unit square, by eight linear
    equations."""
    rows, values = [], []
    for (x, y), (u, v) in zip(corners, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
        values += [u, v]
    return np.append(np.linalg.solve(np.array(rows), values), 1.0).reshape(3, 3)


def at(
    homography: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    across, down, scale = (row[0] * x + row[1] * y + row[2] for row in homography)
    return across / scale, down / scale


def straightforward(room: Nao, game: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns a full rendering with the game drawn on every pixel that shows the screen."""
    rendering = room.view_of_robot.camera.render()
    height, width = rendering.bodies.shape
    corners = room.view_of_robot.camera.project(room.furniture.picture_corners)
    homography = to_unit_square(corners.astype(np.float32).astype(np.float64))

    y, x = np.mgrid[:height, :width].astype(np.float64)
    u, v = at(homography, x, y)
    covered = ((u > 0) & (u < 1) & (v > 0) & (v < 1)).astype(np.float64)
    edge = np.abs(np.stack([u, u - 1, v, v - 1])).min(axis=0) < 0.02
    edge &= (u > -0.1) & (u < 1.1) & (v > -0.1) & (v < 1.1)
    inner = (np.arange(FINER) + 0.5) / FINER - 0.5
    fine_x = x[edge][:, None, None] + inner[None, None, :]
    fine_y = y[edge][:, None, None] + inner[None, :, None]
    fine_u, fine_v = at(homography, fine_x, fine_y)
    inside = (fine_u >= 0) & (fine_u <= 1) & (fine_v >= 0) & (fine_v <= 1)
    covered[edge] = inside.mean(axis=(1, 2))

    # Between two and three rows of the game fall on one of the camera's: it sees the mean of pairs.
    pairs = np.rint(game.reshape(ROWS // 2, 2, COLUMNS, 3).mean(axis=1)).astype(np.int64)
    span = 1 + 2 * BORDER
    on_screen = rendering.bodies == room.furniture.screen
    picture = rendering.rgb.astype(np.float64)
    picture[on_screen] *= 1 - covered[on_screen][:, None]
    lit = on_screen & (covered == 1.0)
    picture[lit] = bilinear(
        pairs, (u[lit] * span - BORDER) * COLUMNS - 0.5, (v[lit] * span - BORDER) * 105 - 0.5
    )
    return np.rint(picture).astype(np.uint8)


def bilinear(
    game: NDArray[np.int64], x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Samples ``game``, surrounded by black, at places rounded to 1/32 pixel."""
    rows, columns = game.shape[:2]
    padded = np.zeros((rows + 4, columns + 4, 3), np.int64)
    padded[2:-2, 2:-2] = game
    across = np.rint(x.astype(np.float32) * 32).astype(np.int64)
    down = np.rint(y.astype(np.float32) * 32).astype(np.int64)
    left, top = np.clip(across >> 5, -2, columns) + 2, np.clip(down >> 5, -2, rows) + 2
    right_share, low_share = (across & 31)[:, None], (down & 31)[:, None]
    upper = padded[top, left] * (32 - right_share) + padded[top, left + 1] * right_share
    lower = padded[top + 1, left] * (32 - right_share) + padded[top + 1, left + 1] * right_share
    return np.asarray((upper * (32 - low_share) + lower * low_share + 512) >> 10, np.int64)


def move_arms(room: Nao, rng: np.random.Generator) -> None:
    """Plays on, holds one or both arms somewhere in front, or leaves them where they are."""
    choice = rng.integers(4)
    if choice == 0:
        room.rest()
        room.command(KEYS_OF_ACTION[rng.integers(18)])
        for _ in range(rng.integers(1, 8)):
            room.step_frame()
    arms = {1: [room.arms.left], 2: [room.arms.left, room.arms.right]}.get(int(choice), [])
    for arm in arms:
        side = 1 if arm is room.arms.left else -1
        low, high = (-1.0, -0.31, -1.2, -1.2), (0.0, 0.1, 0.6, -0.1)
        pose = rng.uniform(low, high) * (1, side, side, side)
        for joint, angle in zip(arm.joints, pose, strict=True):
            room._engine.resetJointState(room.body, joint, angle)


def pictures(rng: np.random.Generator) -> Iterator[NDArray[np.uint8]]:
    """Yields frames of games, noise and plain colours."""
    emulators = [Emulator(game, 0) for game in ("pong", "breakout", "asteroids")]
    while True:
        emulator = emulators[rng.integers(3)]
        for _ in range(5):
            action = int(rng.integers(18))
            for _ in range(4):
                emulator.act(action)
        yield emulator.screen_rgb()
        yield rng.integers(256, size=(ROWS, COLUMNS, 3), dtype=np.uint8)
        yield np.full((ROWS, COLUMNS, 3), rng.integers(256, size=3), np.uint8)


def assert_exact(room: Nao, poses: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    hidden, rendered = 0, 0
    games = pictures(rng)
    for number in range(poses):
        if number % 4 == 0:
            yaw, pitch = rng.uniform(-10, 10, 2)
            room.set_eye(
                CameraConfig(
                    yaw=yaw,
                    pitch=pitch,
                    screen_distance=rng.uniform(0.85, 1.15),
                    screen_tilt=rng.uniform(-6, 6),
                )
            )
            last = room.view_of_robot.rendering()  # so that there is a rendering to reuse
        move_arms(room, rng)
        game = next(games)
        picture = room.picture(game)
        before, last = last, room.view_of_robot.rendering()
        rendered += last is not before
        assert np.array_equal(picture, straightforward(room, game)), f"pose {number} of {seed}"
        hidden += bool((room.view_of_robot.rendering().bodies == room.body).any())
    assert hidden > poses / 8  # arms were in view in many
    assert rendered < poses * 0.8  # and many needed no rendering
    room.rest()
    room.set_eye(PERFECT_CAMERA)


def test_the_fast_picture_is_exact(room: Nao) -> None:
    assert_exact(room, 20, 1)


@pytest.mark.slow
def test_the_fast_picture_is_exact_500_times(room: Nao) -> None:
    assert_exact(room, 500, 2)


def test_the_picture_has_a_black_border(room: Nao) -> None:
    """The border around a white game is black on all sides and as wide as the layout says."""
    picture = room.picture(np.full((ROWS, COLUMNS, 3), 255, np.uint8))
    corners = room.seen_at(room.furniture.picture_corners)
    u, v = at(to_unit_square(corners), *np.meshgrid(np.arange(320.0), np.arange(240.0)))
    away = np.minimum(np.minimum(u, 1 - u), np.minimum(v, 1 - v)) * (1 + 2 * BORDER)
    border = (away > 0.01) & (away < BORDER - 0.015)
    assert border.sum() > 2000
    assert (picture[border] == 0).all()
    assert (picture[away > BORDER + 0.015] == 255).all()


def test_an_arm_hides_the_picture(room: Nao) -> None:
    """Pixels segmented as arm show the arm's colour, whatever is projected."""
    for joint, angle in zip(room.arms.left.joints, (-0.5, -0.1, 0.0, -0.6), strict=True):
        room._engine.resetJointState(room.body, joint, angle)
    arm = room.view_of_robot.camera.render()
    black, white = (
        room.picture(np.full((ROWS, COLUMNS, 3), level, np.uint8)) for level in (0, 255)
    )
    in_front = arm.bodies == room.body
    room.rest()
    free = room.picture(np.full((ROWS, COLUMNS, 3), 255, np.uint8)) != room.picture(
        np.zeros((ROWS, COLUMNS, 3), np.uint8)
    )
    hidden = in_front & free.any(axis=2)
    assert hidden.sum() > 100
    assert np.array_equal(black[hidden], arm.rgb[hidden])
    assert np.array_equal(white[hidden], arm.rgb[hidden])
