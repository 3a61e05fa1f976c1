"""The room: a NAO on a chair at a desk with the controller, in front of the projection screen.

The room owns the physics. An environment commands keys and reads the pressed keys and the robot's
camera picture.
"""

import tempfile
from pathlib import Path

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.robots.interface import ViewName
from actors.robots.nao.arms import Arms
from actors.robots.nao.assembly import Piece, assemble
from actors.robots.nao.camera import top_camera
from actors.robots.nao.controller import CAP_RADIUS, Controller
from actors.robots.nao.engine import open_engine
from actors.robots.nao.furniture import DESK_TOP, PICTURE_CORNERS, Furniture
from actors.robots.nao.posture import TORSO_ORIGIN
from actors.robots.nao.projector import Projection
from actors.robots.nao.sensor import PERFECT_CAMERA, Sensor
from actors.robots.nao.silence import silenced
from actors.robots.nao.still_view import Movable, StillView
from actors.robots.nao.urdf import write_urdf
from actors.robots.nao.viewpoint import Viewpoint, Views, place_of
from common.actions import Keys
from common.run.config import CameraConfig, PlayConfig

PHYSICS_RATE = 240
"""Physics steps per second."""
FRAME_SUBSTEPS = 4
"""Physics steps per emulator frame (60 Hz)."""
# With predicted contacts even 1 iteration presses all 18 actions from anywhere; without, it took
# 10.
_SOLVER_ITERATIONS = 4
# The engine predicts contacts from 0.6 × the half diagonal of a fingertip's box, 5 mm: the distance
# that a fingertip at 1.2 m/s covers in a step. Otherwise it penetrates before the contact is found.
_CONTACT_DISTANCE = 0.6
_FINGERTIPS, _SOLID = 1, 2


class Room:
    """One room in its own physics client; ``game_size`` is the game picture's rows and columns."""

    def __init__(
        self,
        game_size: tuple[int, int] = (210, 160),
        camera: CameraConfig = PERFECT_CAMERA,
        play: PlayConfig | None = None,
    ) -> None:
        """``play`` is for robots that follow some of its settings; this one follows none."""
        self._game_size = game_size
        self._camera = camera
        self.sensor = Sensor(camera)
        """Turns the pinhole's picture into the robot's."""
        self._open = True
        self._engine = open_engine()
        with silenced(), tempfile.TemporaryDirectory() as folder:
            self._build(Path(folder))

    def _build(self, folder: Path) -> None:
        engine = self._engine
        self._step = engine.stepSimulation
        engine.setGravity(0.0, 0.0, -9.81)
        engine.setPhysicsEngineParameter(
            fixedTimeStep=1 / PHYSICS_RATE,
            numSolverIterations=_SOLVER_ITERATIONS,
            contactBreakingThreshold=_CONTACT_DISTANCE,
            deterministicOverlappingPairs=1,
        )
        self.furniture = Furniture(engine)
        self.body: int = engine.loadURDF(
            str(write_urdf(folder)),
            TORSO_ORIGIN,
            useFixedBase=True,
            flags=engine.URDF_USE_INERTIA_FROM_FILE,
        )
        for link in range(engine.getNumJoints(self.body)):
            engine.changeDynamics(self.body, link, linearDamping=0.0, angularDamping=0.0)
        self.controller = Controller(engine, folder, DESK_TOP)
        self.arms = Arms(engine, self.body, self.controller)
        self._limit_contacts()
        self._moves = self._movables()
        self.pose()
        self.arms.settle()
        # Keys sink a little under their own weight: let them come to rest.
        for _ in range(PHYSICS_RATE // 2):
            engine.stepSimulation()
        self._at_rest: int = engine.saveState()
        self.rest()

    def _limit_contacts(self) -> None:
        """Allow contacts only between a fingertip and a solid body.

        Otherwise the engine checks every pair within the contact threshold, decoration included.
        """
        engine = self._engine
        for body in map(engine.getBodyUniqueId, range(engine.getNumBodies())):
            for link in range(-1, engine.getNumJoints(body)):
                if not engine.getCollisionShapeData(body, link):
                    groups = (0, 0)
                else:
                    groups = (_FINGERTIPS, _FINGERTIPS | _SOLID)
                    if body != self.body:
                        groups = (_SOLID, _FINGERTIPS)
                engine.setCollisionFilterGroupMask(body, link, *groups)

    def _movables(self) -> list[Movable]:
        pieces = assemble()[0]
        named = [
            (self._engine.getJointInfo(self.body, link)[12].decode(), link)
            for link in range(self._engine.getNumJoints(self.body))
        ]
        arms = [
            Movable(self.body, link, _extent(pieces[name]))
            for name, link in named
            if name in pieces
        ]
        keys = [Movable(self.controller.body, link, CAP_RADIUS) for link in self.controller.links]
        return arms + keys

    def _appearance_of_keys(self) -> Keys:
        self.controller.show()
        return self.controller.held

    def rest(self) -> None:
        """Restore the start state: hands at rest over released keys, identical every time."""
        self._engine.restoreState(self._at_rest)
        self.furniture.push_screen(self._screen_away)
        self.arms.settle()
        self.controller.forget()

    def pose(self, *, yaw: float = 0.0, pitch: float = 0.0, distance: float = 1.0) -> None:
        """Turn the camera and move the screen, relative to their usual poses.

        The drawn head does not turn: the robot does not see it.

        Args:
            yaw: Degrees to the robot's left.
            pitch: Degrees down.
            distance: Distance from camera to screen, as a multiple of the usual one.
        """
        margin = (0, 0) if self.sensor.lens is None else self.sensor.lens.margin
        camera = top_camera(self._engine, margin=margin, yaw=yaw, pitch=pitch)
        usual = float(PICTURE_CORNERS[0, 0] - top_camera(self._engine).position[0])
        self._screen_away = (distance - 1) * usual
        self.furniture.push_screen(self._screen_away)
        corners, screen = self.furniture.picture_corners, self.furniture.screen
        self.view_of_robot = StillView(self._engine, camera, self._moves, self._appearance_of_keys)
        self._projection = Projection(
            camera, corners, screen, self._game_size, self._camera.ambient
        )
        self._views = Views(self._engine, screen, self._game_size, corners)

    def begin_game(self, rng: Generator) -> None:
        """Draw the poses and camera faults of a new game, within the configured ranges."""
        most, nearest = self._camera.camera_jitter, self._camera.screen_jitter
        if most > 0 or nearest > 0:
            yaw, pitch = rng.uniform(-most, most, 2)
            self.pose(yaw=yaw, pitch=pitch, distance=1 + rng.uniform(-nearest, nearest))
        self.sensor.begin_game(rng)

    @property
    def held(self) -> Keys:
        """The keys pressed at the end of the last frame."""
        return self.controller.held

    def command(self, keys: Keys) -> None:
        """Command the hands to hold exactly ``keys`` down."""
        self.arms.command(keys)

    def step_frame(self) -> Keys:
        """Simulate one emulator frame (1/60 s); returns the keys pressed at its end."""
        self.arms.advance()
        for _ in range(FRAME_SUBSTEPS):
            self._step()
        return self.controller.pressed()

    def picture(self, game: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Returns a pinhole's picture from the robot's camera, with ``game uint8 [rows, columns,
        3]`` projected: ``uint8 [240, 320, 3]``, larger by the lens's margin."""
        return self._projection.draw(self.view_of_robot.rendering(), game)

    def camera_picture(self, screen: NDArray[np.uint8], agent_steps: int = 1) -> NDArray[np.uint8]:
        """What the robot's camera gives, with its faults; see `Robot`."""
        return self.sensor.take(self.picture(screen), agent_steps)

    def proprioception(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Angles and speeds of both arms' joints, left first; see `Robot`."""
        return self.arms.posture()

    def true_corners(self) -> NDArray[np.float64]:
        """Where the projected picture's corners are in the robot's picture; see `Robot`."""
        return self.seen_at(self.furniture.picture_corners)

    def seen_at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the pixels (x, y) of room ``points [N, 3]`` in the robot's picture, ``[N,
        2]``."""
        seen = self.view_of_robot.camera.project(points)
        lens = self.sensor.lens
        return seen if lens is None else lens.bend(seen - np.array(lens.margin))

    def view(
        self,
        game: NDArray[np.uint8],
        width: int = 640,
        height: int = 480,
        viewpoint: ViewName | Viewpoint = "room",
        *,
        moved: bool = True,
    ) -> NDArray[np.uint8]:
        """Returns a visitor's view of the room, ``uint8 [height, width, 3]`` (0.1 s or more).

        Without ``moved`` (1 ms) only the game is drawn anew, over the last rendering.
        """
        self.controller.show()
        return self._views.picture(place_of(viewpoint), game, width, height, moved=moved)

    def close(self) -> None:
        """Disconnect the physics client; the room cannot be used afterwards. It may be called
        twice."""
        if self._open:
            self._engine.disconnect()
        self._open = False


def _extent(piece: Piece) -> float:
    """Returns the radius around the centre of mass that holds all of a piece's shapes, m."""
    return max(
        float(np.linalg.norm(np.array(shape.origin) - piece.centre)) + shape.radius
        for shape in piece.shapes
    )
