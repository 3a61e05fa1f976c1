"""Detects the screen from many poses: errors of its corners, and of the frames that are then seen.

A new detector, which knows no earlier place, searches each picture; except in the cases in which an
arm rises before a screen that was already detected.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.envs.emulator import Emulator
from actors.envs.observation import shrink
from actors.robots.nao.robot import Nao
from actors.vision.layout import GAME_IN_PICTURE
from actors.vision.screen_detector import Detection, ScreenDetector
from common.settings.conditions import PERFECT_CAMERA, CameraConfig, PlayConfig
from common.settings.ranges import NOTHING_DRAWN, RandomiseConfig, draw

POSES = RandomiseConfig(head_pose=10.0, screen_distance=0.15)
"""Range of the poses from which each case is seen."""

_HIDDEN = (0.01, 0.25)
"""Share of the projected picture, border included, that raised arms hide."""
_POSE_LOW, _POSE_HIGH = (-0.9, -0.31, -1.2, -1.2), (-0.1, 0.0, 0.6, -0.1)
"""Bounds of the joint angles of a raised left arm; some of these poses are in view."""


@dataclass(frozen=True)
class FaultyCamera:
    """A camera with its faults, and the ranges of what differs from pose to pose."""

    camera: CameraConfig = PERFECT_CAMERA
    changes: RandomiseConfig = NOTHING_DRAWN


PERFECT = FaultyCamera()
FAULTS = FaultyCamera(
    CameraConfig(noise=8.0, blur=1.0, distortion=0.06, ambient=0.15),
    RandomiseConfig(exposure=0.3, colour=0.2, gamma=1.6, glare=0.4, screen_tilt=5.0),
)
"""All faults that a single picture can have, at once."""


@dataclass(frozen=True)
class Case:
    """An eye, and when, if at all, an arm is raised in front of the screen."""

    name: str
    eye: FaultyCamera = PERFECT
    arm: Literal["never", "later", "before"] = "never"


def cases() -> list[Case]:
    """Returns the cases: a perfect eye, each fault alone, and all faults.

    The perfect eye and all faults come also with an arm in front of the screen.
    """
    alone = [
        Case(name.replace("_", " "), replace(PERFECT, **{part: replace(usual, **{name: value})}))
        for part, usual in vars(PERFECT).items()
        for name, value in vars(getattr(FAULTS, part)).items()
        if value != getattr(usual, name)
    ]
    return [
        Case("perfect"),
        *alone,
        Case("all faults", FAULTS),
        Case("perfect, an arm rises", arm="later"),
        Case("all faults, an arm rises", FAULTS, "later"),
        Case("perfect, arm before first look", arm="before"),
        Case("all faults, arm before first look", FAULTS, "before"),
    ]


@dataclass
class Tally:
    """The results of one case and game."""

    pictures: int = 0
    errors: list[float] = field(default_factory=list)
    """Error of the worst corner of each picture in which the screen was found, pixels."""
    differences: list[float] = field(default_factory=list)
    """Mean absolute differences to the emulator's own 84×84 frames, grey levels."""

    def __add__(self, other: "Tally") -> "Tally":
        return Tally(
            self.pictures + other.pictures,
            self.errors + other.errors,
            self.differences + other.differences,
        )

    def figures(self) -> dict[str, Any]:
        """Returns counts and percentiles; None where nothing was found."""
        p50, p95 = np.percentile(self.errors, [50, 95]).tolist() if self.errors else (None, None)
        return {
            "pictures": self.pictures,
            "found": len(self.errors) / self.pictures,
            "p50_px": p50,
            "p95_px": p95,
            "max_px": max(self.errors, default=None),
            "difference": float(np.mean(self.differences)) if self.differences else None,
        }


@dataclass(frozen=True)
class Look:
    """One picture, its detection, and the true corners."""

    case: Case
    game: str
    picture: NDArray[np.uint8]
    detection: Detection
    truth: NDArray[np.float64]
    """True corners, ``[4, 2]``, as `Detection.corners`."""


def measure(
    case: Case,
    games: tuple[str, ...],
    poses: int,
    rng: Generator,
    keep: Callable[[Look], object] = lambda look: None,
) -> dict[str, Tally]:
    """Detects each game's screen from many poses; ``keep`` gets every look."""
    room = Nao()
    emulators = {game: Emulator(game, int(rng.integers(2**31))) for game in games}
    tallies = {game: Tally() for game in games}
    for _ in range(poses):
        begin_game(room, case.eye, POSES, rng)
        detectors = {game: ScreenDetector(room.camera.distortion) for game in games}
        if case.arm != "never":
            if case.arm == "later":
                for game, emulator in emulators.items():
                    detectors[game].detect(room.sensor.take(room.picture(emulator.screen_rgb())))
            _raise_arm(room, rng)
        for game, emulator in emulators.items():
            _play_on(emulator, rng)
            picture = room.sensor.take(room.picture(emulator.screen_rgb()))
            look = Look(case, game, picture, detectors[game].detect(picture), corners_in(room))
            tally = tallies[game]
            tally.pictures += 1
            if look.detection.valid and look.detection.corners is not None:
                away = np.linalg.norm(look.detection.corners - look.truth, axis=1)
                tally.errors.append(float(away.max()))
                own = shrink(emulator.screen_grey()).astype(int)
                tally.differences.append(float(np.abs(look.detection.frame - own).mean()))
            keep(look)
    room.close()
    return tallies


def corners_in(room: Nao) -> NDArray[np.float64]:
    """Returns the game's corners in the robot's picture by the room's geometry, ``[4, 2]``."""
    left_top, right_top, _, left_bottom = room.furniture.picture_corners
    across, down = right_top - left_top, left_bottom - left_top
    return room.seen_at(
        np.array([left_top + u * across + v * down for u, v in GAME_IN_PICTURE.astype(float)])
    )


def begin_game(room: Nao, eye: FaultyCamera, poses: RandomiseConfig, rng: Generator) -> None:
    """Puts the robot's hands at rest, and its ``eye`` in one of ``poses``."""
    ranges = replace(eye.changes, head_pose=poses.head_pose, screen_distance=poses.screen_distance)
    room.begin_game(draw(PlayConfig(), eye.camera, ranges, rng.random), rng)
    room.arms.settle()


def _raise_arm(room: Nao, rng: Generator) -> None:
    """Raises an arm in front of the projected picture, hiding as much of it as `_HIDDEN` says."""
    while not _HIDDEN[0] < _hidden_share(room) < _HIDDEN[1]:
        room.arms.left.place(rng.uniform(_POSE_LOW, _POSE_HIGH))


def _hidden_share(room: Nao) -> float:
    """Returns the share of the projected picture's pixels that the robot's body hides."""
    rendering = room.view_of_robot.rendering()
    outline = room.view_of_robot.camera.project(room.furniture.picture_corners)
    inside = np.zeros(rendering.bodies.shape, np.uint8)
    cv2.fillConvexPoly(inside, np.rint(outline).astype(np.int32), 1)
    return float((rendering.bodies == room.body)[inside == 1].mean())


def _play_on(emulator: Emulator, rng: Generator) -> None:
    """Plays at random for a while, so that each picture is different."""
    for action in rng.integers(18, size=rng.integers(5, 30)).repeat(4):
        emulator.act(int(action))
    if emulator.game_over:
        emulator.reset()
