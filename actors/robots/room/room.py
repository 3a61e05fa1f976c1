"""The room: a screen with the projected game, and in front of it one robot with camera and hands.

The room owns the physics client and renders all pictures; a robot is a subclass that adds its body
and moves it. An environment commands keys, and reads the pressed keys and the camera picture.
"""

import tempfile
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.robots.room.body import Limbs, Pressed
from actors.robots.room.camera import Mount
from actors.robots.room.engine import open_engine
from actors.robots.room.furniture import PICTURE_CORNERS, Box, Furniture
from actors.robots.room.projector import Projection
from actors.robots.room.scene import Scene
from actors.robots.room.sensor import Sensor
from actors.robots.room.silence import silenced
from actors.robots.room.still_view import StillView
from actors.robots.room.viewpoint import Viewpoint, Views
from common.actions import Keys
from common.games import SCREEN_SHAPE
from common.protocol.live_view import ViewName
from common.settings.conditions import (
    DEFAULT_PLAY,
    FRAMES_PER_SECOND,
    PERFECT_CAMERA,
    CameraConfig,
    Conditions,
    PlayConfig,
)

PHYSICS_RATE = 240
"""Physics steps per second."""
FRAME_SUBSTEPS = PHYSICS_RATE // FRAMES_PER_SECOND
"""Physics steps per emulator frame."""
# With predicted contacts even 1 iteration lets NAO press all 18 actions from anywhere; without
# them, it takes 10.
_SOLVER_ITERATIONS = 4
# The engine predicts contacts from 0.6 × the half diagonal of a fingertip's box, 5 mm: the distance
# that a fingertip at 1.2 m/s covers in a step. Otherwise it penetrates before the contact is found.
_CONTACT_SHARE = 0.6
_FINGERTIPS, _SOLID = 1, 2


class Room(ABC):
    """Implements `Robot` in its own physics client; ``screen_shape`` is the game picture's rows and
    columns."""

    mount: ClassVar[Mount]
    """Position of the robot's camera."""
    viewpoints: ClassVar[Mapping[ViewName, Viewpoint]]
    """Viewpoints from which people look at the robot."""
    own_furniture: ClassVar[Sequence[Box]] = ()
    """Furniture that only this robot has."""
    arms: Limbs
    """The robot's limbs."""
    controller: Pressed
    """The controller that they press."""

    def __init__(
        self,
        screen_shape: tuple[int, int] = SCREEN_SHAPE,
        camera: CameraConfig = PERFECT_CAMERA,
        play: PlayConfig = DEFAULT_PLAY,
    ) -> None:
        """``play`` says how fast the arms are and how far a key must go down to count."""
        self._screen_shape = screen_shape
        self._open = True
        self._engine = open_engine()
        with silenced(), tempfile.TemporaryDirectory() as folder:
            self._furnish(Path(folder), camera, play)

    def _furnish(self, folder: Path, camera: CameraConfig, play: PlayConfig) -> None:
        engine = self._engine
        self._step = engine.stepSimulation
        engine.setGravity(0.0, 0.0, -9.81)
        engine.setPhysicsEngineParameter(
            fixedTimeStep=1 / PHYSICS_RATE,
            numSolverIterations=_SOLVER_ITERATIONS,
            contactBreakingThreshold=_CONTACT_SHARE,
            deterministicOverlappingPairs=1,
        )
        self.furniture = Furniture(engine, self.own_furniture)
        self._build(folder)
        self._limit_contacts(self.arms.body)
        self._set_hands(play)
        self._moves = {each.body: each.movables for each in (self.arms, self.controller)}
        self.set_eye(camera)
        self._settle()
        # Keys sink a little under their own weight: let them come to rest.
        for _ in range(PHYSICS_RATE // 2):
            engine.stepSimulation()
        self._at_rest: int = engine.saveState()
        self.rest()

    @abstractmethod
    def _build(self, folder: Path) -> None:
        """Puts `arms` and `controller` into the room; ``folder`` is for their descriptions."""

    def _set_hands(self, play: PlayConfig) -> None:
        self.arms.limit_speed(play.arm_speed)
        self.controller.set_threshold(play.key_threshold)

    def _settle(self) -> None:
        self.arms.settle()
        self.controller.forget()

    @property
    def held(self) -> Keys:
        return self.controller.held

    def command(self, keys: Keys) -> None:
        self.arms.command(keys)

    def proprioception(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return self.arms.posture()

    def rest(self) -> None:
        """Restores the start state: hands at rest over released keys, identical every time."""
        self._engine.restoreState(self._at_rest)
        self.furniture.place_screen(*self.furniture.screen_place)
        self._settle()

    def step_frame(self) -> Keys:
        self.arms.advance()
        for _ in range(FRAME_SUBSTEPS):
            self._step()
        return self.controller.pressed()

    def set_eye(self, camera: CameraConfig) -> None:
        """Sets the robot's eye, its pose and the screen's place as ``camera`` says.

        The drawn head does not turn, because the robot does not see it.
        """
        self.camera = camera
        """Settings of the robot's eye."""
        self.sensor = Sensor(camera)
        """Turns the pinhole's picture into the robot's."""
        margin = (0, 0) if self.sensor.lens is None else self.sensor.lens.margin
        eye = self.mount.camera(self._engine, margin=margin, yaw=camera.yaw, pitch=camera.pitch)
        usual = float(PICTURE_CORNERS[0, 0] - self.mount.camera(self._engine).position[0])
        self.furniture.place_screen((camera.screen_distance - 1) * usual, camera.screen_tilt)
        corners, screen = self.furniture.picture_corners, self.furniture.screen
        self.view_of_robot = StillView(self._engine, eye, self._moves, self._appearance)
        self._projection = Projection(eye, corners, screen, self._screen_shape, camera)
        self._views = Views(self._engine, screen, self._screen_shape, corners, self.scene)

    def _limit_contacts(self, body: int) -> None:
        """Allows contacts only between solid parts of the robot's ``body`` and other solid bodies,
        and among the robot's own solid parts if its URDF was loaded with
        ``URDF_USE_SELF_COLLISION``, as NAO's and the robotroller's are not.

        Otherwise the engine checks every pair within the contact threshold, decoration included.
        """
        engine = self._engine
        for each in map(engine.getBodyUniqueId, range(engine.getNumBodies())):
            for link in range(-1, engine.getNumJoints(each)):
                if not engine.getCollisionShapeData(each, link):
                    groups = (0, 0)
                else:
                    groups = (_FINGERTIPS, _FINGERTIPS | _SOLID)
                    if each != body:
                        groups = (_SOLID, _FINGERTIPS)
                engine.setCollisionFilterGroupMask(each, link, *groups)

    def _appearance(self) -> Keys:
        self.controller.show()
        return self.held

    def begin_game(self, conditions: Conditions, rng: Generator) -> None:
        self._set_hands(conditions.play)
        if conditions.camera != self.camera:
            self.set_eye(conditions.camera)
        self.sensor.begin_game(rng)

    def picture(self, game: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Returns a pinhole's picture from the robot's camera, with ``game uint8 [rows, columns,
        3]`` projected. It is ``uint8 [240, 320, 3]``, enlarged by the lens's margin."""
        return self._projection.draw(self.view_of_robot.rendering(), game)

    def camera_picture(self, screen: NDArray[np.uint8], agent_steps: int = 1) -> NDArray[np.uint8]:
        return self.sensor.take(self.picture(screen), agent_steps, self._projection.backdrop)

    def true_corners(self) -> NDArray[np.float64]:
        return self.seen_at(self.furniture.picture_corners)

    def seen_at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the pixels (x, y) of room ``points [N, 3]`` in the robot's picture, ``[N,
        2]``."""
        seen = self.view_of_robot.camera.project(points)
        lens = self.sensor.lens
        return seen if lens is None else lens.bend(seen - np.array(lens.margin))

    def view(
        self,
        screen: NDArray[np.uint8],
        width: int = 640,
        height: int = 480,
        viewpoint: ViewName = "room",
        *,
        moved: bool = True,
        turn: float = 0.0,
    ) -> NDArray[np.uint8]:
        """Returns a visitor's view of the room, ``uint8 [height, width, 3]``.

        The first picture from a viewpoint takes 0.1 s or more; for later ones only what moved is
        rendered again. Without ``moved`` only the game is redrawn over the last rendering (1 ms).
        """
        self.controller.show()
        seen_from = self.viewpoints[viewpoint]
        return self._views.picture(
            seen_from, screen, width, height, moved=moved, turn=turn, appearance=self.held
        )

    def scene(self) -> Scene:
        """Returns the room's shapes and their poses, for viewers that render them."""
        hands = {self.arms.body: "robot", self.controller.body: "controller"}
        return Scene(self._engine, {**self.furniture.names, **hands}, self.arms.body)

    def close(self) -> None:
        """Disconnects the physics client; the room cannot be used afterwards. Closing twice does no
        harm."""
        if self._open:
            self._engine.disconnect()
        self._open = False
