"""The screen detector against camera pictures of known geometry.

The pictures are made independently of the product: rays are cast from a pinhole camera at a wall,
in plain numpy, without homographies or OpenCV's warping.
"""

import sys
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.envs.emulator import Emulator
from actors.envs.observation import shrink
from actors.vision.layout import ASPECT, BORDER
from actors.vision.screen_detector import ScreenDetector

_WIDTH, _HEIGHT = 320, 240
_FOCAL = _WIDTH / 2 / np.tan(np.radians(60.97 / 2))  # NAO's camera
_GAME_WIDTH = 1.0
_GAME_HEIGHT = _GAME_WIDTH / ASPECT
_GAME_CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (_GAME_WIDTH / 2, _GAME_HEIGHT / 2)


class Pose(NamedTuple):
    """Position and rotation of the camera in front of the wall at z = 0 (x right, y down)."""

    position: tuple[float, float, float] = (0.0, 0.0, -1.6)
    yaw: float = 0.0
    pitch: float = 0.0

    @property
    def rotation(self) -> NDArray[np.float64]:
        (cy, sy), (cp, sp) = ((np.cos(a), np.sin(a)) for a in np.radians((self.yaw, self.pitch)))
        turn = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        tilt = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
        return np.asarray(turn @ tilt, np.float64)

    def project(self, on_wall: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the pixels of points (x, y) on the wall."""
        points = np.column_stack([on_wall, np.zeros(len(on_wall))]) - self.position
        x, y, z = (points @ self.rotation).T
        return np.column_stack([_FOCAL * x / z, _FOCAL * y / z]) + _CENTRE


_CENTRE = ((_WIDTH - 1) / 2, (_HEIGHT - 1) / 2)


def _random_pose(rng: np.random.Generator) -> Pose:
    """Returns a pose within ±10° of yaw and pitch and ±15 % of distance, a little to one side."""
    x, y = rng.uniform(-0.08, 0.08, 2)
    distance = 1.7 * rng.uniform(0.85, 1.15)
    # Turned so that the middle of the view stays near the picture, whatever the angle.
    yaw, pitch = rng.uniform(-10, 10, 2)
    lean = -distance * np.tan(np.radians(yaw)) * 0.9, distance * np.tan(np.radians(pitch)) * 0.9
    return Pose((x + lean[0], y + lean[1], -distance), yaw, pitch)


def _photograph(
    pose: Pose,
    game: NDArray[np.uint8],
    *,
    samples: int = 3,
    wall: float = 190.0,
    distortion: float = 0.0,
) -> NDArray[np.float64]:
    """Returns a picture of ``game`` projected on the wall, from ``samples``² rays per pixel.

    A lens of the ``distortion`` k₁ shows at r' what a pinhole shows at r'(1 + k₁r'²), in units of
    half the width.
    """
    total = np.zeros((_HEIGHT, _WIDTH, 3))
    for dy in range(samples):
        for dx in range(samples):
            u = np.arange(_WIDTH) + (dx + 0.5) / samples - 0.5 - _CENTRE[0]
            v = np.arange(_HEIGHT) + (dy + 0.5) / samples - 0.5 - _CENTRE[1]
            u, v = np.meshgrid(u, v)
            further = 1 + distortion * (u**2 + v**2) / (_WIDTH / 2) ** 2
            u, v = u * further, v * further
            rays = np.stack([u, v, np.full_like(u, _FOCAL)], axis=-1) @ pose.rotation.T
            far = -pose.position[2] / rays[..., 2]
            x = (pose.position[0] + far * rays[..., 0]) / _GAME_WIDTH + 0.5
            y = (pose.position[1] + far * rays[..., 1]) / _GAME_HEIGHT + 0.5
            colour = np.broadcast_to(wall + 10 * np.sin(3 * x), (3, *x.shape)).transpose(1, 2, 0)
            colour = colour * (1.0, 0.97, 0.9)
            colour[np.maximum(abs(x - 0.5), abs(y - 0.5)) < 0.5 + BORDER] = 0
            rows, columns = np.floor(y * len(game)), np.floor(x * game.shape[1])
            on = (rows >= 0) & (rows < len(game)) & (columns >= 0) & (columns < game.shape[1])
            colour[on] = game[rows[on].astype(int), columns[on].astype(int)]
            total += colour
    return total / samples**2


def _digital(
    picture: NDArray[np.float64], rng: np.random.Generator, noise: float = 0.0
) -> NDArray[np.uint8]:
    noisy = picture + noise * rng.standard_normal(picture.shape)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


Screens = dict[str, NDArray[np.uint8]]
"""What the emulator shows, by game."""


@pytest.fixture(scope="module")
def screens() -> Screens:
    found = {"white": np.full((210, 160, 3), 255, np.uint8), "black": np.zeros((210, 160, 3), "u1")}
    for game in ("pong", "space_invaders", "asteroids", "breakout"):
        emulator = Emulator(game, 0)
        for frame in range(240):
            emulator.act(frame // 4 % 18)
        found[game] = emulator.screen_rgb()
    return found


def _error(corners: NDArray[np.float32] | None, pose: Pose) -> float:
    """Returns the error of the worst corner, pixels."""
    assert corners is not None
    return float(np.linalg.norm(corners - pose.project(_GAME_CORNERS), axis=1).max())


@pytest.mark.parametrize("game", ["white", "black", "pong", "space_invaders", "asteroids"])
@pytest.mark.parametrize(("samples", "noise"), [(3, 4.0), (1, 0.0), (1, 8.0)])
def test_corners_are_within_a_pixel_and_a_half(
    screens: Screens, game: str, samples: int, noise: float
) -> None:
    rng = np.random.default_rng([samples, int(noise), len(game)])
    errors = []
    for _ in range(8):
        pose = _random_pose(rng)
        picture = _photograph(pose, screens[game], samples=samples, wall=rng.uniform(110, 240))
        detection = ScreenDetector().detect(_digital(picture, rng, noise))
        assert detection.valid
        assert detection.corners is not None
        assert detection.corners.dtype == np.float32
        errors.append(_error(detection.corners, pose))
    assert np.percentile(errors, 95) <= 1.5


@pytest.mark.parametrize("distortion", [0.05, 0.2])
def test_the_screen_is_found_through_a_lens_and_straightened(
    screens: Screens, distortion: float
) -> None:
    rng = np.random.default_rng(13)
    for _ in range(3):
        pose = _random_pose(rng)
        straight = ScreenDetector().detect(_digital(_photograph(pose, screens["pong"]), rng))
        picture = _photograph(pose, screens["pong"], distortion=distortion)
        away = (pose.project(_GAME_CORNERS) - _CENTRE) / (_WIDTH / 2)
        seen = away.copy()
        for _ in range(100):  # until r' = r / (1 + k₁r'²)
            seen = away / (1 + distortion * (seen**2).sum(axis=1, keepdims=True))
        detector = ScreenDetector(distortion)
        for noise in (0.0, 3.0, 3.0):  # the later ones at a known place
            found = detector.detect(_digital(picture, rng, noise))
            assert found.valid
            assert found.corners is not None
            error = found.corners - (_CENTRE + seen * _WIDTH / 2)
            assert np.linalg.norm(error, axis=1).max() <= 1.5
            assert np.corrcoef(found.frame.ravel(), straight.frame.ravel())[0, 1] > 0.98


def test_hands_in_front_of_the_lower_edge_do_not_move_the_corners(screens: Screens) -> None:
    rng = np.random.default_rng(3)
    for colour in (235, 20):
        for _ in range(6):
            pose = _random_pose(rng)
            picture = _photograph(pose, screens["pong"])
            bottom = pose.project(_GAME_CORNERS * (1 + 2 * BORDER))[2:]
            left, right = sorted(bottom[:, 0])
            top = int(bottom[:, 1].min()) - 12
            detector = ScreenDetector()
            detector.detect(_digital(picture, rng))  # the arms come into view later
            for share in rng.uniform(0.05, 0.75, 2):
                start = int(left + share * (right - left))
                picture[top:, start : start + int(0.2 * (right - left))] = colour
            detection = detector.detect(_digital(picture, rng, 3.0))
            assert detection.valid
            assert _error(detection.corners, pose) <= 1.5


def test_a_corner_hidden_at_the_first_detection_is_where_its_sides_meet(screens: Screens) -> None:
    rng = np.random.default_rng(4)
    pose = Pose()
    picture = _photograph(pose, screens["pong"])
    x, y = pose.project(_GAME_CORNERS * (1 + 2 * BORDER))[3]
    picture[int(y) - 20 :, : int(x) + 25] = 240
    detection = ScreenDetector().detect(_digital(picture, rng))
    assert detection.valid
    assert _error(detection.corners, pose) <= 1.5


def test_a_dark_hand_along_a_whole_side_is_not_taken_for_the_side(screens: Screens) -> None:
    """A hidden side cannot be located: the detector finds no screen rather than a wrong one."""
    rng = np.random.default_rng(11)
    refused = 0
    for game in ("pong", "breakout", "asteroids", "white"):
        for share in (-0.01, 0.02, 0.05, 0.1):
            pose = _random_pose(rng)
            picture = _photograph(pose, screens[game])
            x, y = pose.project(_GAME_CORNERS * (1 + 2 * BORDER)).T
            edge = min(x[0], x[3]) + share * (x[1] - x[0])
            picture[int(y.min()) - 15 : int(y.max()) + 15, : int(edge) + 4] = 45
            detection = ScreenDetector().detect(_digital(picture, rng, 3.0))
            refused += not detection.valid
            assert not detection.valid or _error(detection.corners, pose) <= 1.5
    assert refused >= 12


def test_a_hidden_side_does_not_matter_once_the_screen_is_known(screens: Screens) -> None:
    """Three sides in place confirm the screen, unless it moved meanwhile."""
    rng = np.random.default_rng(12)
    for noise in (0.0, 6.0):
        for _ in range(4):
            pose = _random_pose(rng)
            detector = ScreenDetector()
            known = detector.detect(_digital(_photograph(pose, screens["pong"]), rng, noise))
            assert known.corners is not None
            x, y, z = pose.position
            for nudge, moved in ((0.0, False), (0.03, True)):
                now = pose._replace(position=(x + nudge, y + nudge, z))
                picture = _photograph(now, screens["pong"])
                corners = pose.project(_GAME_CORNERS * (1 + 2 * BORDER))
                picture[:, : int(max(corners[[0, 3], 0])) + 6] = 45
                detection = detector.detect(_digital(picture, rng, noise))
                assert detection.valid != moved
                assert detection.corners is not None
                assert np.array_equal(detection.corners, known.corners)


def test_the_frame_is_the_emulators_own(screens: Screens) -> None:
    rng = np.random.default_rng(5)
    for game in ("pong", "space_invaders"):
        for _ in range(4):
            picture = _photograph(_random_pose(rng), screens[game], samples=4)
            seen = ScreenDetector().detect(_digital(picture, rng)).frame
            grey = screens[game] @ (0.299, 0.587, 0.114)
            own = shrink(grey.round().astype(np.uint8))
            assert seen.shape == (84, 84)
            assert seen.dtype == np.uint8
            assert np.abs(seen.astype(int) - own).mean() <= 8
            assert np.corrcoef(seen.ravel(), own.ravel())[0, 1] > 0.9


def test_a_frame_is_not_mirrored_or_shifted() -> None:
    game = np.zeros((210, 160, 3), np.uint8)
    game[:105, :80] = 255  # top left quarter
    seen = (
        ScreenDetector().detect(_digital(_photograph(Pose(), game), np.random.default_rng(0))).frame
    )
    assert (seen[:40, :40] > 245).mean() > 0.97
    assert (seen[44:] < 10).all()
    assert (seen[:, 44:] < 10).all()
    middle = seen[20].astype(float)
    assert middle.sum() / 255 == pytest.approx(42, abs=0.5)


def test_before_the_first_detection_the_frame_is_empty_and_invalid() -> None:
    for grey in (0, 128, 255):
        detection = ScreenDetector().detect(np.full((_HEIGHT, _WIDTH, 3), grey, np.uint8))
        assert not detection.valid
        assert detection.corners is None
        assert not detection.frame.any()
        assert detection.frame.shape == (84, 84)


def test_without_a_screen_the_last_homography_is_kept(screens: Screens) -> None:
    rng = np.random.default_rng(6)
    pose = _random_pose(rng)
    picture = _digital(_photograph(pose, screens["pong"]), rng)
    detector = ScreenDetector()
    good = detector.detect(picture)
    assert good.corners is not None
    for blank in (np.zeros_like(picture), np.full_like(picture, 130)):
        detection = detector.detect(blank)
        assert not detection.valid
        assert detection.corners is not None
        assert np.array_equal(detection.corners, good.corners)
        assert (detection.frame == blank[0, 0, 0]).all()
    again = detector.detect(picture)
    assert again.valid
    assert np.array_equal(again.frame, good.frame)


@pytest.mark.parametrize(("wall", "found"), [(18.0, False), (60.0, True)])
def test_a_screen_that_is_hardly_darker_than_its_wall_is_not_detected(
    screens: Screens, wall: float, found: bool
) -> None:
    picture = _photograph(Pose(), screens["black"], wall=wall)
    assert ScreenDetector().detect(_digital(picture, np.random.default_rng(14))).valid == found


def test_dark_objects_without_a_black_border_are_not_detected() -> None:
    rng = np.random.default_rng(7)
    for trial in range(20):
        picture = np.full((_HEIGHT, _WIDTH, 3), 200.0)
        ys, xs = np.mgrid[:_HEIGHT, :_WIDTH]
        if trial % 2:  # a dark disk
            x, y, radius = rng.uniform((100, 90, 40), (220, 150, 90))
            picture[(xs - x) ** 2 + (ys - y) ** 2 < radius**2] = 0
        else:  # a dark frame, far thinner than the border
            x, y = rng.integers((20, 20), (90, 60))
            picture[y : y + 150, x : x + 200] = 0
            picture[y + 4 : y + 146, x + 4 : x + 196] = 200
        assert not ScreenDetector().detect(_digital(picture, rng, 3.0)).valid


@pytest.mark.parametrize(
    ("taller", "skew", "found"),
    [(1.0, 0.0, True), (0.97, 0.0, False), (1.03, 0.0, False), (1.0, 0.04, False)],
)
def test_a_quadrilateral_of_another_shape_is_not_the_screen(
    monkeypatch: pytest.MonkeyPatch, screens: Screens, taller: float, skew: float, found: bool
) -> None:
    monkeypatch.setattr(sys.modules[__name__], "_GAME_HEIGHT", taller * _GAME_HEIGHT)
    straight = _photograph(Pose(yaw=3.0), screens["pong"], wall=180 * taller)
    lines = [np.roll(line, round(skew * row), axis=0) for row, line in enumerate(straight)]
    picture = _digital(np.stack(lines), np.random.default_rng(15))
    assert ScreenDetector().detect(picture).valid == found


@pytest.mark.parametrize("black", [0, 100, 140])
def test_ambient_light_lifts_the_screen_above_the_black_of_other_objects(
    screens: Screens, black: int
) -> None:
    pose = Pose()
    picture = black + _photograph(pose, screens["pong"]) * (1 - black / 255)
    picture[200:, :80] = 0
    detection = ScreenDetector().detect(_digital(picture, np.random.default_rng(16)))
    assert detection.valid
    assert _error(detection.corners, pose) <= 1.5


@pytest.mark.parametrize("cable", [False, True])
def test_the_largest_of_several_screens_is_the_one(screens: Screens, cable: bool) -> None:
    """Even if a cable makes the dark region of the smaller one the larger region."""
    large, small = Pose((0.67, 0.0, -2.6)), Pose((-1.32, 0.0, -4.0))
    picture = np.minimum(*(_photograph(pose, screens["black"]) for pose in (large, small)))
    if cable:
        picture[149:, 250:254] = picture[230:234, 20:254] = 0
    for expected in (large, small):
        seen = _digital(picture, np.random.default_rng(17))
        assert _error(ScreenDetector().detect(seen).corners, expected) <= 1.5
        picture[:220, :160] = 190  # the large one is covered


def test_a_screen_cut_off_by_the_pictures_edge_is_not_detected(screens: Screens) -> None:
    pose = Pose(position=(0.75, 0.0, -1.6))
    picture = _photograph(pose, screens["pong"])
    assert pose.project(_GAME_CORNERS)[0, 0] < 0
    assert not ScreenDetector().detect(_digital(picture, np.random.default_rng(8))).valid


def test_a_moved_camera_is_followed(screens: Screens) -> None:
    rng = np.random.default_rng(9)
    detector = ScreenDetector()
    for _ in range(6):
        pose = _random_pose(rng)
        picture = _digital(_photograph(pose, screens["space_invaders"]), rng, 2.0)
        detection, new = detector.detect(picture), ScreenDetector().detect(picture)
        assert detection.valid
        assert _error(detection.corners, pose) <= 1.5
        assert np.corrcoef(detection.frame.ravel(), new.frame.ravel())[0, 1] > 0.99
