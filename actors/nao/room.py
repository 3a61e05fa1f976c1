"""The room: a NAO on a chair at a desk with the controller, before the projector's screen.

It owns the physics and is all that an environment needs: keys to be pressed go in, keys that
are pressed and the robot's own camera picture come out.
"""

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from actors.nao.arms import Arms
from actors.nao.assembly import Piece, assemble
from actors.nao.camera import Camera, Movable, StillView, top_camera
from actors.nao.controller import CAP_RADIUS, Controller
from actors.nao.engine import open_engine
from actors.nao.furniture import DESK_TOP, PICTURE_CORNERS, Furniture
from actors.nao.posture import TORSO_ORIGIN
from actors.nao.projector import Projection
from actors.nao.silence import silenced
from actors.nao.urdf import write_urdf
from common.actions import Keys

PHYSICS_RATE = 240
"""Steps per second."""
FRAME_SUBSTEPS = 4
"""Physics steps per emulator frame, at 60 Hz."""
# With 5 a fingertip could be wedged between keys; from 10 on its depth is right to 0.03 mm.
_SOLVER_ITERATIONS = 12

_VISITOR = np.array([-0.62, -1.22, 0.92])
_VISITOR_LOOKS_AT = np.array([0.50, 0.02, 0.36])
_VISITOR_ANGLE = 42.0


class Room:
    """One room in a physics client of its own; ``game_size`` is the picture's rows and columns."""

    def __init__(self, game_size: tuple[int, int] = (210, 160)) -> None:
        self._game_size = game_size
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
            engine.changeDynamics(
                self.body, link, lateralFriction=0.2, linearDamping=0.0, angularDamping=0.0
            )
        self.controller = Controller(engine, folder, DESK_TOP)
        self.arms = Arms(engine, self.body, self.controller)
        self.view_of_robot = StillView(
            engine, top_camera(engine), self._movables(), self._look_of_keys
        )
        self._projection = self._project_for(self.view_of_robot.camera)
        self._visits: dict[tuple[int, int], tuple[Camera, Projection]] = {}
        self.arms.settle()
        # Keys sink by a hair under their own weight: let them come to rest.
        for _ in range(PHYSICS_RATE // 2):
            engine.stepSimulation()
        self._at_rest: int = engine.saveState()
        self.reset()

    def _movables(self) -> list[Movable]:
        pieces = assemble()[0]
        named = [
            (self._engine.getJointInfo(self.body, link)[12].decode(), link)
            for link in range(self._engine.getNumJoints(self.body))
        ]
        arms = [Movable(self.body, link, _extent(pieces[name])) for name, link in named]
        keys = [Movable(self.controller.body, link, CAP_RADIUS) for link in self.controller.links]
        return arms + keys

    def _look_of_keys(self) -> Keys:
        self.controller.show()
        return self.controller.held

    def reset(self) -> None:
        """Hands at rest over released keys, whatever was before, exactly the same every time."""
        self._engine.restoreState(self._at_rest)
        self.arms.settle()
        self.controller.forget()

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
        """What the robot's camera sees while ``game uint8 [rows, columns, 3]`` is projected:
        ``uint8 [240, 320, 3]``."""
        return self._projection.draw(self.view_of_robot.rendering(), game)

    def view(
        self, game: NDArray[np.uint8], width: int = 640, height: int = 480
    ) -> NDArray[np.uint8]:
        """The room as a visitor sees it, ``uint8 [height, width, 3]`` (0.1 s or more)."""
        if (width, height) not in self._visits:
            self._visits[width, height] = self._visit(width, height)
        camera, projection = self._visits[width, height]
        self.controller.show()
        return projection.draw(camera.render(), game)

    def _visit(self, width: int, height: int) -> tuple[Camera, Projection]:
        tall = _VISITOR_ANGLE
        wide = 2 * np.degrees(np.arctan(np.tan(np.radians(tall) / 2) * width / height))
        camera = Camera(
            self._engine,
            _VISITOR,
            _VISITOR_LOOKS_AT - _VISITOR,
            np.array([0.0, 0.0, 1.0]),
            size=(width, height),
            angles=(float(wide), tall),
        )
        return camera, self._project_for(camera)

    def _project_for(self, camera: Camera) -> Projection:
        return Projection(camera, PICTURE_CORNERS, self.furniture.screen, self._game_size)

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
