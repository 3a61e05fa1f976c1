"""Each camera fault does what its setting says, and nothing else."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.robots.nao.camera import top_camera
from actors.robots.nao.furniture import PICTURE_CORNERS
from actors.robots.nao.room import Room
from actors.robots.nao.sensor import PERFECT_CAMERA, Sensor
from actors.vision.lens import Lens
from common.run.config import CameraConfig

SIZE = (320, 240)
FAULTS = {
    "noise": CameraConfig(noise=5.0),
    "blur": CameraConfig(blur=1.0),
    "exposure": CameraConfig(exposure=0.3),
    "colour_gain": CameraConfig(colour_gain=0.2),
    "distortion": CameraConfig(distortion=0.05),
}


@pytest.fixture(scope="module")
def room() -> Iterator[Room]:
    room = Room()
    yield room
    room.close()


def grey(level: int, size: tuple[int, int] = SIZE) -> NDArray[np.uint8]:
    return np.full((size[1], size[0], 3), level, np.uint8)


def begun(config: CameraConfig, seed: int = 0) -> Sensor:
    sensor = Sensor(config)
    sensor.begin_game(np.random.default_rng(seed))
    return sensor


def scene(config: CameraConfig) -> NDArray[np.uint8]:
    """Returns a colourful picture, larger by the lens's margin."""
    lens = Sensor(config).lens
    across, down = (0, 0) if lens is None else lens.margin
    y, x = np.mgrid[: SIZE[1] + 2 * down, : SIZE[0] + 2 * across]
    waves = [100 + 60 * np.sin(x / 9), 100 + 60 * np.cos(y / 7), 100 + 60 * np.sin((x + y) / 11)]
    return np.stack(waves, axis=2).astype(np.uint8)


def test_all_faults_are_off_by_default() -> None:
    assert CameraConfig() == PERFECT_CAMERA
    assert not any(vars(PERFECT_CAMERA).values())
    picture = scene(PERFECT_CAMERA)
    sensor = begun(PERFECT_CAMERA)
    assert sensor.take(picture) is picture
    assert sensor.take(grey(3)).max() == 3  # and no picture has latency


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_changes_the_picture_and_a_seed_repeats_it(fault: str) -> None:
    config = FAULTS[fault]
    picture = scene(config)
    kept = picture.copy()

    def taken(seed: int) -> list[NDArray[np.uint8]]:
        sensor = begun(config, seed)
        return [sensor.take(picture) for _ in range(3)]

    first, again, other = taken(1), taken(1), taken(2)
    assert np.array_equal(first, again)
    assert first[0].shape == (240, 320, 3)
    assert first[0].dtype == np.uint8
    assert not np.array_equal(first[0], scene(PERFECT_CAMERA))
    drawn = fault in ("noise", "exposure", "colour_gain")
    assert np.array_equal(first, other) != drawn
    assert np.array_equal(picture, kept)


def test_noise_has_its_deviation_no_bias_and_is_new_in_each_picture() -> None:
    sensor = begun(CameraConfig(noise=6.0))
    pictures = np.stack([sensor.take(grey(128)).astype(float) - 128 for _ in range(8)])
    assert pictures.std() == pytest.approx(6.0, rel=0.02)
    assert abs(pictures.mean()) < 0.05
    together = np.corrcoef(pictures.reshape(8, -1)) - np.eye(8)
    assert np.abs(together).max() < 0.02
    channels = np.corrcoef(pictures[0].reshape(-1, 3).T) - np.eye(3)
    assert np.abs(channels).max() < 0.02


def test_noise_stops_at_black_and_white() -> None:
    sensor = begun(CameraConfig(noise=20.0))
    assert sensor.take(grey(0)).max() < 128
    assert sensor.take(grey(255)).min() > 127


def test_blur_spreads_a_point_by_its_deviation() -> None:
    picture = grey(0)
    picture[120, 160] = 255
    spread = begun(CameraConfig(blur=1.5)).take(picture)[:, :, 0].astype(float)
    y, x = np.nonzero(spread)
    weights = spread[y, x]
    assert weights.sum() == pytest.approx(255, rel=0.1)
    assert np.average(x, weights=weights) == pytest.approx(160)
    assert np.average((x - 160) ** 2, weights=weights) == pytest.approx(1.5**2, rel=0.15)
    assert np.average((y - 120) ** 2, weights=weights) == pytest.approx(1.5**2, rel=0.15)


def test_exposure_scales_all_colours_alike_by_at_most_its_share() -> None:
    factors = []
    for seed in range(60):
        sensor = begun(CameraConfig(exposure=0.3), seed)
        red, green, blue = sensor.take(grey(100))[0, 0].tolist()
        assert red == green == blue
        assert np.array_equal(sensor.take(grey(100)), sensor.take(grey(100)))  # all game long
        factors.append(red / 100)
    assert min(factors) >= 0.69
    assert max(factors) <= 1.31
    assert max(factors) - min(factors) > 0.4
    assert begun(CameraConfig(exposure=0.3), 1).take(grey(255)).max() <= 255


def test_colour_gain_scales_each_colour_by_itself() -> None:
    gains = np.array(
        [begun(CameraConfig(colour_gain=0.2), seed).take(grey(100))[0, 0] for seed in range(60)]
    )
    assert gains.min() >= 80
    assert gains.max() <= 120
    assert (gains.std(axis=0) > 8).all()
    assert np.abs(np.corrcoef(gains.T) - np.eye(3)).max() < 0.4


def test_a_lens_shows_things_where_browns_formula_says() -> None:
    """Bright points of the pinhole's picture are found at their places in the lens's."""
    lens = Lens(0.08, SIZE)
    across, down = lens.margin
    rng = np.random.default_rng(0)
    middle = np.array([159.5, 119.5])
    for _ in range(20):
        place = rng.integers((-across + 2, -down + 2), (320 + across - 2, 240 + down - 2))
        ideal = np.zeros((240 + 2 * down, 320 + 2 * across, 3), np.uint8)
        ideal[place[1] + down - 1 : place[1] + down + 2, :, :][
            :, place[0] + across - 1 : place[0] + across + 2
        ] = 255
        seen = lens.photograph(ideal)[:, :, 0].astype(float)
        assert seen.shape == (240, 320)
        if not seen.any():
            continue
        y, x = np.nonzero(seen)
        found = np.array([np.average(x, weights=seen[y, x]), np.average(y, weights=seen[y, x])])
        if not (3 < found[0] < 316 and 3 < found[1] < 236):
            continue
        away = (found - middle) / 160
        pinhole = middle + away * (1 + 0.08 * (away @ away)) * 160
        assert np.linalg.norm(pinhole - place) < 0.4


def test_a_lens_bends_and_unbends_back() -> None:
    lens = Lens(0.1, SIZE)
    points = np.random.default_rng(0).uniform((0, 0), (319, 239), (200, 2))
    assert np.allclose(lens.bend(lens.unbend(points)), points, atol=1e-6)
    assert np.allclose(lens.bend(np.array([[159.5, 119.5]])), [[159.5, 119.5]])


def test_a_straightened_picture_is_the_pinholes() -> None:
    config = CameraConfig(distortion=0.06)
    lens = Lens(config.distortion, SIZE)
    across, down = lens.margin
    ideal = scene(config)
    back = lens.straighten(begun(config).take(ideal)).astype(int)
    own = ideal[down:-down, across:-across].astype(int)
    inner = np.abs(back - own)[6:-6, 6:-6]
    assert inner.mean() < 1.5
    assert inner.max() < 20


@pytest.mark.parametrize("latency", [0, 1, 2, 3])
def test_picture_latency_is_whole_agent_steps(latency: int) -> None:
    sensor = begun(CameraConfig(latency=latency))
    seen = [int(sensor.take(grey(number), 1 if number else 0)[0, 0, 0]) for number in range(8)]
    assert seen == [max(0, number - latency) for number in range(8)]


def test_picture_latency_counts_agent_steps_not_pictures() -> None:
    sensor = begun(CameraConfig(latency=2))
    sensor.take(grey(10), 0)
    assert sensor.take(grey(13), 3).max() == 10  # nothing newer is two agent steps old
    assert sensor.take(grey(15), 2).max() == 13


def test_a_new_game_shows_nothing_of_the_last() -> None:
    sensor = begun(CameraConfig(latency=3))
    for level in range(5):
        sensor.take(grey(level))
    sensor.begin_game(np.random.default_rng(1))
    assert sensor.take(grey(99), 0).min() == 99


def test_jitter_turns_the_camera_and_moves_the_screen(room: Room) -> None:
    """Poses differ between games within their bounds, and repeat with the seed."""
    room._camera = CameraConfig(camera_jitter=6.0, screen_jitter=0.1)
    usual = top_camera(room._engine)

    def turned(seed: int) -> tuple[float, float]:
        """Returns the camera's rotation from its usual pose, °, and the screen's relative
        distance."""
        room.begin_game(np.random.default_rng(seed))
        gaze, before = room.view_of_robot.camera._to_clip[3, :3], usual._to_clip[3, :3]
        away = np.degrees(np.arccos(gaze @ before / np.linalg.norm(gaze) / np.linalg.norm(before)))
        near = room.furniture.picture_corners[0, 0] - usual.position[0]
        return float(away), float(near / (PICTURE_CORNERS[0, 0] - usual.position[0]))

    poses = [turned(seed) for seed in range(12)]
    angles, distances = np.array(poses).T
    assert poses[:2] == [turned(seed) for seed in range(2)]
    assert 2 < angles.max() < 6 * np.sqrt(2) + 0.5
    assert len(set(angles)) == len(set(distances)) == 12
    assert (np.abs(distances - 1) <= 0.1).all()
    assert np.ptp(distances) > 0.1
    room._camera = PERFECT_CAMERA
    room.pose()


def test_ambient_light_lifts_black_and_keeps_white() -> None:
    plain, lit = Room(), Room(camera=replace(PERFECT_CAMERA, ambient=0.2))
    for level, expected in ((0, 51), (255, 255), (100, 51 + 80)):
        game = np.full((210, 160, 3), level, np.uint8)
        dark, light = plain.picture(game), lit.picture(game)
        assert dark[120, 160].tolist() == [level] * 3
        assert light[120, 160].tolist() == [expected] * 3
        off_screen = plain.view_of_robot.rendering().bodies != plain.furniture.screen
        assert np.array_equal(dark[off_screen], light[off_screen])
    plain.close()
    lit.close()
