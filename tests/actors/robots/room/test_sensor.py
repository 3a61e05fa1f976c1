"""Each camera fault does what its setting says, and nothing else."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.robots.nao.robot import Nao
from actors.robots.room.camera import Camera
from actors.robots.room.furniture import PICTURE_CORNERS, PICTURE_HEIGHT
from actors.robots.room.sensor import Backdrop, Sensor
from actors.vision.lens import Lens
from common.settings.conditions import PERFECT_CAMERA, CameraConfig, Conditions, PlayConfig

SIZE = (320, 240)
FAULTS = {
    "noise": CameraConfig(noise=5.0),
    "blur": CameraConfig(blur=1.0),
    "brightness": CameraConfig(brightness=0.7),
    "colour": CameraConfig(red=1.1, green=0.8),
    "gamma": CameraConfig(gamma=1.6),
    "distortion": CameraConfig(distortion=0.05),
}


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
    assert np.array_equal(first, other) == (fault != "noise")
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


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        (CameraConfig(brightness=1.3), [0, 130, 255]),  # 260 is white
        (CameraConfig(brightness=0.7), [0, 70, 140]),
        (CameraConfig(gamma=2.0), [0, 39, 157]),  # 100²/255, 200²/255
        (CameraConfig(gamma=0.5), [0, 160, 226]),  # √(100 × 255), √(200 × 255)
        (CameraConfig(brightness=0.5, gamma=2.0), [0, 10, 39]),  # gains first: 50²/255, 100²/255
    ],
)
def test_tones_of_black_middle_and_light(settings: CameraConfig, expected: list[int]) -> None:
    sensor = begun(settings)
    for level, seen in zip((0, 100, 200), expected, strict=True):
        assert sensor.take(grey(level))[0, 0].tolist() == [seen] * 3


def test_colours_have_gains_of_their_own() -> None:
    sensor = begun(CameraConfig(red=1.5, green=0.5, blue=1.2, gamma=2.0))
    # 150²/255, 50²/255, 120²/255
    assert sensor.take(grey(100))[0, 0].tolist() == [88, 10, 56]


def test_a_grey_picture_has_the_same_tones_and_noise() -> None:
    sensor = Sensor(CameraConfig(gamma=2.0, noise=6.0, blur=0.5), (84, 84))
    sensor.begin_game(np.random.default_rng(0))
    taken = np.stack([sensor.take(np.full((84, 84), 200, np.uint8)) for _ in range(30)])
    assert taken.shape == (30, 84, 84)
    assert taken.mean() == pytest.approx(157, abs=0.2)
    assert taken.std() == pytest.approx(6.0, rel=0.03)


@pytest.mark.parametrize(
    "settings",
    [
        CameraConfig(blur=0.4),
        CameraConfig(blur=1.0),
        CameraConfig(gamma=1.5, red=0.8),
        CameraConfig(distortion=0.06),
        CameraConfig(distortion=0.3, blur=3.0),
        CameraConfig(noise=5.0, dropped=0.3, latency=1),
        CameraConfig(noise=5.0, blur=0.7, distortion=0.03, gamma=0.7, dropped=0.3),
    ],
)
@pytest.mark.parametrize(
    "window",
    [
        (slice(70, 160), slice(95, 225)),
        (slice(0, 30), slice(0, 40)),
        (slice(225, 240), slice(130, 320)),
        (slice(0, 240), slice(0, 320)),
    ],
)
def test_what_is_known_of_a_backdrop_saves_time_and_changes_nothing(
    settings: CameraConfig, window: tuple[slice, slice]
) -> None:
    knowing, plain = begun(settings), begun(settings)
    rng = np.random.default_rng(0)
    shape = scene(settings).shape
    across, down = (shape[1] - 320) // 2, (shape[0] - 240) // 2
    rows, columns = (
        slice(each.start + more, each.stop + more)
        for each, more in zip(window, (down, across), strict=True)
    )
    for _ in range(2):
        background = rng.integers(256, size=shape, dtype=np.uint8)
        for _ in range(4):
            picture = background.copy()
            game = picture[rows, columns]
            game[:] = rng.integers(256, size=game.shape, dtype=np.uint8)
            known = Backdrop(background, (rows, columns))
            assert np.array_equal(knowing.take(picture, 1, known), plain.take(picture, 1))
            assert np.array_equal(picture[rows, columns], game)


def test_before_a_known_backdrop_only_the_window_is_developed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sensor = begun(CameraConfig(blur=1.0, gamma=1.2))
    sizes = []
    develop = sensor._develop

    def measured(ideal: NDArray[np.uint8], window: tuple[slice, slice]) -> NDArray[np.uint8]:
        developed = develop(ideal, window)
        sizes.append(developed.shape[:2])
        return developed

    monkeypatch.setattr(sensor, "_develop", measured)
    background = object()
    for _ in range(3):
        sensor.take(grey(100), 1, Backdrop(background, (slice(100, 120), slice(50, 80))))
    # The blur reaches 3 pixels: 6 more on each side make 3 right ones.
    assert sizes == [(240, 320), (32, 42), (32, 42)]


def test_lost_pictures_are_the_ones_before_seen_again() -> None:
    sensor = begun(CameraConfig(dropped=0.3))
    seen = [int(sensor.take(grey(number % 256))[0, 0, 0]) for number in range(2_000)]
    lost = 0
    for number, (before, now) in enumerate(pairwise(seen), start=1):
        assert now in (number % 256, before)
        lost += now == before
    assert seen[0] == 0
    assert lost / 1_999 == pytest.approx(0.3, abs=0.03)


def test_a_camera_that_loses_all_pictures_but_the_first_is_frozen() -> None:
    sensor = begun(CameraConfig(dropped=1.0))
    assert [int(sensor.take(grey(number)).max()) for number in range(5, 10)] == [5] * 5


def test_a_lost_picture_is_missed_when_it_would_have_been_seen() -> None:
    """With a latency of two agent steps, two later: the one before it is seen twice."""
    sensor = begun(CameraConfig(latency=2, dropped=0.5))
    draws = iter([0.9, 0.9, 0.9, 0.1, 0.9, 0.9, 0.9, 0.9])  # the fourth, of level 3, is lost

    class Scripted:
        def random(self) -> float:
            return next(draws)

    sensor._rng = Scripted()  # type: ignore[assignment]
    seen = [int(sensor.take(grey(n), 1 if n else 0).max()) for n in range(8)]
    assert seen == [0, 0, 0, 1, 2, 2, 4, 5]


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


def test_a_corner_by_hand() -> None:
    """It is 159.5 and 119.5 from the middle: k₁r'² = 0.08 · (159.5² + 119.5²) / 160² = 0.12413."""
    lens = Lens(0.08, (320, 240))
    assert np.allclose(lens.unbend(np.zeros((1, 2))), [[-19.798, -14.833]], atol=1e-3)
    assert lens.margin == (20, 15)


def test_a_lens_bends_and_unbends_back() -> None:
    lens = Lens(0.1, SIZE)
    points = np.random.default_rng(0).uniform((0, 0), (319, 239), (200, 2))
    assert np.allclose(lens.bend(lens.unbend(points)), points, atol=1e-6)
    assert np.allclose(lens.bend(np.array([[159.5, 119.5]])), [[159.5, 119.5]])


def test_parts_of_a_lenss_pictures_are_those_of_the_whole() -> None:
    lens = Lens(0.1, SIZE)
    across, down = lens.margin
    rng = np.random.default_rng(0)
    ideal = rng.integers(256, size=(240 + 2 * down, 320 + 2 * across), dtype=np.uint8)
    image = rng.integers(256, size=(240, 320), dtype=np.uint8)
    window = (slice(31, 97), slice(200, 318))
    assert np.array_equal(lens.photograph(ideal, window), lens.photograph(ideal)[window])
    assert np.array_equal(lens.straighten(image, window), lens.straighten(image)[window])


@pytest.mark.parametrize("place", [(60, 80), (118, 150), (180, 260), (3, 5)])
def test_a_lens_knows_where_a_part_of_the_pinholes_picture_is_shown(
    place: tuple[int, int],
) -> None:
    """All pixels that change with it lie within, and the window is no larger than needed."""
    lens = Lens(0.2, SIZE)
    across, down = lens.margin
    window = tuple(slice(start, start + 40) for start in place)
    dark = np.zeros((240 + 2 * down, 320 + 2 * across), np.uint8)
    light = dark.copy()
    light[window] = 255
    rows, columns = np.nonzero(lens.photograph(light))
    shown = lens.shown((window[0], window[1]))
    seen = np.zeros((500, 500), bool)  # beyond the picture, too
    seen[shown[0].start + 100 : shown[0].stop + 100, shown[1].start + 100 : shown[1].stop + 100] = 1
    assert seen[rows + 100, columns + 100].all()
    if len(rows):
        assert shown[0].stop - shown[0].start <= np.ptp(rows) + 8
        assert shown[1].stop - shown[1].start <= np.ptp(columns) + 8


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


def test_the_eye_turns_and_the_screen_moves_as_told(room: Nao) -> None:
    usual = Nao.mount.camera(room._engine)

    def gaze(camera: Camera) -> NDArray[np.float64]:
        forward: NDArray[np.float64] = camera._to_clip[3, :3]
        return forward / np.linalg.norm(forward)

    for settings, turned, distance in (
        (CameraConfig(yaw=5.0), 5.0, 1.0),
        (CameraConfig(pitch=-7.0), 7.0, 1.0),
        (CameraConfig(screen_distance=1.15), 0.0, 1.15),
    ):
        room.begin_game(Conditions(PlayConfig(), settings), np.random.default_rng(0))
        away = float(gaze(room.view_of_robot.camera) @ gaze(usual))
        # A head that is pitched turns the same whatever its posture; yaw is about the vertical.
        assert np.degrees(np.arccos(min(away, 1.0))) == pytest.approx(turned, abs=0.15)
        near = room.furniture.picture_corners[:, 0] - usual.position[0]
        assert near / (PICTURE_CORNERS[0, 0] - usual.position[0]) == pytest.approx(distance)
    left, down = (
        gaze(room.mount.camera(room._engine, yaw=5)),
        gaze(room.mount.camera(room._engine, pitch=5)),
    )
    assert left[1] > 0.05
    assert left[2] == pytest.approx(gaze(usual)[2])  # about the vertical
    assert down[2] < gaze(usual)[2] - 0.05
    room.set_eye(PERFECT_CAMERA)


def test_points_are_seen_where_the_lens_shows_them(room: Nao) -> None:
    """A white spot in the middle of the game, beside the middle of the robot's picture."""
    game = np.zeros((210, 160, 3), np.uint8)
    game[95:115, 72:88] = 255
    for yaw, pitch in ((8.0, 6.0), (-8.0, 6.0), (0.0, -8.0)):
        room.set_eye(CameraConfig(distortion=0.08, yaw=yaw, pitch=pitch))
        dark, lit = (room.camera_picture(each)[:, :, 0] for each in (0 * game, game))
        rows, columns = np.nonzero(lit.astype(int) - dark > 127)
        ((x, y),) = room.seen_at(room.furniture.picture_corners.mean(axis=0)[None])
        assert (columns.mean(), rows.mean()) == pytest.approx((x, y), abs=1.0)
    room.set_eye(PERFECT_CAMERA)


def test_a_tilted_screen_leans_back_about_its_middle(room: Nao) -> None:
    room.set_eye(CameraConfig(screen_tilt=30.0, screen_distance=1.1))
    corners = room.furniture.picture_corners
    usual = float(PICTURE_CORNERS[0, 0] - Nao.mount.camera(room._engine).position[0])
    middle = PICTURE_CORNERS.mean(axis=0) + np.array([0.1 * usual, 0.0, 0.0])
    assert corners.mean(axis=0) == pytest.approx(middle)
    half = PICTURE_HEIGHT / 2
    # By sin 30° and cos 30° of half its height.
    assert corners[:2, 0] - middle[0] == pytest.approx(half * 0.5)
    assert corners[:2, 2] - middle[2] == pytest.approx(half * np.sqrt(3) / 2)
    assert corners[2:, 0] - middle[0] == pytest.approx(-half * 0.5)
    assert corners[:, 1] == pytest.approx(PICTURE_CORNERS[:, 1])
    sheet = room.view_of_robot.camera.render().bodies == room.furniture.screen
    room.rest()
    assert np.array_equal(room.furniture.picture_corners, corners)
    assert np.array_equal(room.view_of_robot.camera.render().bodies == room.furniture.screen, sheet)
    room.set_eye(PERFECT_CAMERA)


def test_what_is_as_usual_is_not_made_anew(room: Nao) -> None:
    view, sensor = room.view_of_robot, room.sensor
    room.begin_game(Conditions(PlayConfig(), CameraConfig()), np.random.default_rng(0))
    assert (room.view_of_robot, room.sensor) == (view, sensor)


def test_stray_light_lifts_black_and_keeps_white() -> None:
    plain = Nao()
    for settings, black, white, middle in (
        (CameraConfig(ambient=0.2), 51, 255, 51 + 80),
        (CameraConfig(glare=0.4), 102, 255, 102 + 60),  # in the glare's middle
        (CameraConfig(ambient=0.2, glare=0.5), 153, 255, 153 + 40),
    ):
        lit = Nao(camera=settings)
        u, v = PICTURE_CORNERS[1] - PICTURE_CORNERS[0], PICTURE_CORNERS[3] - PICTURE_CORNERS[0]
        column, row = np.rint(lit.seen_at((PICTURE_CORNERS[0] + (u + v) / 2)[None])[0]).astype(int)
        for level, expected in ((0, black), (255, white), (100, middle)):
            game = np.full((210, 160, 3), level, np.uint8)
            dark, light = plain.picture(game), lit.picture(game)
            assert dark[row, column].tolist() == [level] * 3
            assert light[row, column] == pytest.approx(expected, abs=1)
            off_screen = plain.view_of_robot.rendering().bodies != plain.furniture.screen
            assert np.array_equal(dark[off_screen], light[off_screen])
        lit.close()
    plain.close()
