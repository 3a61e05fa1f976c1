"""The room: a NAO on a chair at a desk with the controller, before the projector's screen.

It owns the physics and is all that an environment needs: keys to be pressed go in, keys that
are pressed and the robot's own camera picture come out.
"""

import tempfile
from pathlib import Path

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.robots.nao.arms import Arms
from actors.robots.nao.assembly import Piece, assemble
from actors.robots.nao.camera import Movable, StillView, top_camera
from actors.robots.nao.controller import CAP_RADIUS, Controller
from actors.robots.nao.engine import open_engine
from actors.robots.nao.furniture import DESK_TOP, PICTURE_CORNERS, Furniture
from actors.robots.nao.posture import TORSO_ORIGIN
from actors.robots.nao.projector import Projection
from actors.robots.nao.sensor import PERFECT_CAMERA, Sensor
from actors.robots.nao.silence import silenced
from actors.robots.nao.urdf import write_urdf
from actors.robots.nao.viewpoint import VISITOR, Viewpoint, Views
from common.actions import Keys
from common.run.config import CameraConfig

PHYSICS_RATE = 240
"""Steps per second."""
FRAME_SUBSTEPS = 4
"""Physics steps per emulator frame, at 60 Hz."""
# With foresight even 1 would press all 18 actions from anywhere (without, it took 10).
_SOLVER_ITERATIONS = 4
# The engine foresees contacts from 0.6 × the half diagonal of a fingertip's box, 5 mm: what a
# fingertip of 1.2 m/s goes in a step. Without, it sinks in before it is noticed.
_FORESIGHT = 0.6
_FINGERTIPS, _SOLID = 1, 2


class Room:
    """One room in a physics client of its own; ``game_size`` is the picture's rows and columns."""

    def __init__(
        self, game_size: tuple[int, int] = (210, 160), camera: CameraConfig = PERFECT_CAMERA
    ) -> None:
        self._game_size = game_size
        self._camera = camera
        self.sensor = Sensor(camera)
        """What makes the robot's picture of what a pinhole sees."""
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
            contactBreakingThreshold=_FORESIGHT,
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
        # Keys sink by a hair under their own weight: let them come to rest.
        for _ in range(PHYSICS_RATE // 2):
            engine.stepSimulation()
        self._at_rest: int = engine.saveState()
        self.reset()

    def _limit_contacts(self) -> None:
        """Let fingertips touch all that is solid, and nothing else touch anything.

        The engine looks at every pair that foresight lets seem near, those that are only there
        to be seen too.
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

    def _look_of_keys(self) -> Keys:
        self.controller.show()
        return self.controller.held

    def reset(self) -> None:
        """Hands at rest over released keys, whatever was before, exactly the same every time."""
        self._engine.restoreState(self._at_rest)
        self.furniture.push_screen(self._screen_away)
        self.arms.settle()
        self.controller.forget()

    def pose(self, *, yaw: float = 0.0, pitch: float = 0.0, distance: float = 1.0) -> None:
        """Turn the camera out of its usual direction and put the screen elsewhere.

        The head is drawn as it was: the robot does not see it.

        Args:
            yaw: Degrees to the robot's left.
            pitch: Degrees down.
            distance: Of the screen from the camera, as a multiple of the usual one.
        """
        margin = (0, 0) if self.sensor.lens is None else self.sensor.lens.margin
        camera = top_camera(self._engine, margin=margin, yaw=yaw, pitch=pitch)
        usual = float(PICTURE_CORNERS[0, 0] - top_camera(self._engine).eye[0])
        self._screen_away = (distance - 1) * usual
        self.furniture.push_screen(self._screen_away)
        corners, screen = self.furniture.picture_corners, self.furniture.screen
        self.view_of_robot = StillView(self._engine, camera, self._moves, self._look_of_keys)
        self._projection = Projection(
            camera, corners, screen, self._game_size, self._camera.ambient
        )
        self._views = Views(self._engine, screen, self._game_size, corners)

    def begin_game(self, rng: Generator) -> None:
        """Draw what the settings let differ from game to game: poses, and the camera's faults."""
        most, nearest = self._camera.camera_jitter, self._camera.screen_jitter
        if most > 0 or nearest > 0:
            yaw, pitch = rng.uniform(-most, most, 2)
            self.pose(yaw=yaw, pitch=pitch, distance=1 + rng.uniform(-nearest, nearest))
        self.sensor.begin_game(rng)

    @property
    def held(self) -> Keys:
        """The keys that were pressed at the end of the last frame."""
        return self.controller.held

    def command(self, keys: Keys) -> None:
        """Let the hands set out to hold exactly ``keys`` down."""
        self.arms.command(keys)

    def step_frame(self) -> Keys:
        """Pass one emulator frame (1/60 s); the keys that are pressed at its end."""
        self.arms.advance()
        for _ in range(FRAME_SUBSTEPS):
            self._step()
        return self.controller.pressed()

    def picture(self, game: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """What a pinhole in the place of the robot's camera sees while ``game uint8 [rows,
        columns, 3]`` is projected: ``uint8 [240, 320, 3]``, larger by the lens's margin."""
        return self._projection.draw(self.view_of_robot.rendering(), game)

    def seen_at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where points of the room, ``[N, 3]``, are in the robot's picture: ``float64 [N, 2]``."""
        seen = self.view_of_robot.camera.project(points)
        lens = self.sensor.lens
        return seen if lens is None else lens.bend(seen - np.array(lens.margin))

    def view(
        self,
        game: NDArray[np.uint8],
        width: int = 640,
        height: int = 480,
        viewpoint: Viewpoint = VISITOR,
        *,
        moved: bool = True,
    ) -> NDArray[np.uint8]:
        """The room as a visitor sees it, ``uint8 [height, width, 3]`` (0.1 s or more).

        Without ``moved`` (1 ms) only the game is new: the rest is as it was the last time.
        """
        self.controller.show()
        return self._views.picture(viewpoint, game, width, height, moved=moved)

    def close(self) -> None:
        """End the physics; the room cannot be used any more. Closing twice does no harm."""
        if self._open:
            self._engine.disconnect()
        self._open = False


def _extent(piece: Piece) -> float:
    """Radius around the centre of mass that holds all of a piece's shapes."""
    return max(
        float(np.linalg.norm(np.array(shape.origin) - piece.centre)) + shape.radius
        for shape in piece.shapes
    )
