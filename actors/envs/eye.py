"""A robot's eye: it takes pictures of the game as it stands, and detects the game in them."""

from collections import deque
from functools import partial
from typing import Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.envs.emulator import Emulator
from actors.envs.eye_timing import eye_latency
from actors.envs.game import AtariGame
from actors.envs.observation import shrink
from actors.envs.sight_check import SightCheck
from actors.robots.interface import Robot
from actors.robots.room.sensor import newest_due
from actors.vision.screen_detector import Detection, ScreenDetector
from common.protocol.step_fields import FRAME_SHAPE
from common.settings.conditions import CameraConfig

_MANY_LOST = 0.25
"""Share of lost pictures beyond which frames may well stand still while the game goes on."""
_UNSEEN = Detection(np.zeros(FRAME_SHAPE, np.uint8), False, None)


class Eye:
    """Sees ``game`` through the camera of ``robot``; with ``source`` "emulator", frames are the
    emulator's own, and the camera is for people."""

    def __init__(
        self, robot: Robot, game: AtariGame, source: Literal["camera", "emulator"]
    ) -> None:
        self._robot = robot
        self._game = game
        self._sees = source == "camera"
        self.detection = _UNSEEN
        """The game as detected in the last picture."""
        self._check = SightCheck()
        self._detector: ScreenDetector
        self._picture: NDArray[np.uint8] | None = None
        self._unseen = 0
        """Agent steps of game time since the last picture was taken."""
        self._now = 0
        """Agent steps of game time until the last picture."""
        self._shown: deque[tuple[int, NDArray[np.uint8]]] = deque()
        """The game's own pictures since the one that the camera's last picture shows, with their
        agent steps, oldest first."""

    def begin_game(self) -> None:
        """Forgets screen and pictures; call it after `Robot.begin_game`."""
        # A seeded game may know nothing of an earlier one, not even where the screen was.
        self._detector = ScreenDetector(self._camera.distortion)
        self.detection = _UNSEEN
        self._check.begin_game()
        self._unseen = self._now = 0
        self._shown.clear()

    def measure_latency(self, rng: Generator) -> int:
        """Returns the latency of the pictures in agent steps, as `eye_latency` measures it; 0 if
        frames are the emulator's own. The robot begins its game anew by ``rng``, so that no picture
        of the test is left."""
        if not self._sees:
            return 0
        shape = (*self._emulator.screen_shape, 3)
        found = eye_latency(partial(self._robot.camera_picture, agent_steps=1), shape)
        self._robot.begin_game(self._game.conditions, rng)
        return found

    @property
    def follows(self) -> bool:
        """Whether the frames changed as the game's own pictures did, when that was last checked; a
        camera that loses many pictures on purpose is not judged."""
        return self._check.verdict.follows or self._camera.dropped > _MANY_LOST

    @property
    def picture(self) -> NDArray[np.uint8]:
        """The camera's last picture, ``uint8 [240, 320, 3]``."""
        if self._picture is None:
            self._picture = self._take_picture()
        return self._picture

    def wait(self, agent_steps: int) -> None:
        """Lets so many agent steps of game time pass, and takes a picture if a later one may be
        that of this moment."""
        self._unseen += agent_steps
        if self._keeps_pictures:
            self._picture = self._take_picture()

    def look(self, agent_steps: int) -> NDArray[np.uint8]:
        """Lets so many agent steps of game time pass, takes a picture, detects the game in it, and
        returns the frame, ``uint8 [84, 84]``."""
        self._unseen += agent_steps
        # Drawing takes a tenth of an agent step, so it is skipped where only a person might look.
        looks = self._sees or self._keeps_pictures
        self._picture = self._take_picture() if looks else None
        if self._sees:
            self._detect()
        else:
            self.detection = Detection(shrink(self._emulator.screen_grey()), True, None)
        return self.detection.frame

    @property
    def _camera(self) -> CameraConfig:
        return self._game.conditions.camera

    @property
    def _emulator(self) -> Emulator:
        return self._game.emulator

    @property
    def _keeps_pictures(self) -> bool:
        """Whether a later picture may be one that is taken now."""
        return self._camera.latency > 0 or self._camera.dropped > 0

    def _take_picture(self) -> NDArray[np.uint8]:
        passed, self._unseen = self._unseen, 0
        screen = self._emulator.screen_rgb()
        self._now += passed
        if passed == 0 and self._shown:
            self._shown.pop()  # a picture of the same moment
        self._shown.append((self._now, screen))
        newest_due(self._shown, self._now - self._camera.latency)  # drops what is seen no more
        return self._robot.camera_picture(screen, passed)

    def _detect(self) -> None:
        self.detection = found = self._detector.detect(self.picture)
        _, shown = self._shown[0]
        self._check.look(found.frame if found.valid else None, shown)
        if not self._check.verdict.shows:
            # The border is in place, but the game in it cannot be seen.
            self.detection = found._replace(valid=False)
