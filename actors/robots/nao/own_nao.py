"""Shows a NAO of the user's own, from a URDF with the maker's meshes, in pictures of the room.

The maker's licence forbids copying the meshes, so this project has none. The robot that plays
stays ours. Its joint angles are copied to the user's robot in a second room, which is only looked
at: its physics never takes a step.
"""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.robots.nao.controller import Controller
from actors.robots.nao.meshes import check_meshes
from actors.robots.nao.posture import ARM_JOINTS, HELD_ANGLES, TORSO_ORIGIN
from actors.robots.nao.robot import Nao
from actors.robots.room.engine import frame_of, joints_of, open_engine
from actors.robots.room.furniture import DESK_TOP, Furniture
from actors.robots.room.silence import silenced
from actors.robots.room.viewpoint import Views
from common.errors import InputError
from common.protocol.live_view import ViewName

_MOVING = tuple(side + name for side in "LR" for name in ARM_JOINTS)
_ON_THE_TORSO = "LShoulderPitch"


class OwnNao:
    """A room with furniture, controller and the user's robot, posed as in another room.

    Args:
        path: URDF. Joints are matched by NAO's published names (LShoulderPitch …). The arms' eight
            joints are required; others, where present, get the angles at which ours are held.
        screen_shape: rows and columns of the game's picture.

    Raises:
        InputError: the file cannot be loaded, shows nothing or lacks joints, or a mesh is missing
            or broken.
    """

    def __init__(self, path: Path, screen_shape: tuple[int, int]) -> None:
        self._engine = open_engine()
        with silenced(), tempfile.TemporaryDirectory() as folder:
            self._furniture = Furniture(self._engine, Nao.own_furniture)
            self._controller = Controller(self._engine, Path(folder), DESK_TOP)
            self._body = _load(self._engine, path)
        self._screen_shape = screen_shape
        self._views = self._new_views()
        self._joints = joints_of(self._engine, self._body, hinges=True)
        if missing := [name for name in _MOVING if name not in self._joints]:
            raise InputError(
                f"{path} has no joints called {', '.join(missing)}: --nao-urdf needs a robot "
                "with NAO's joint names."
            )
        for name, angle in HELD_ANGLES.items():
            if name in self._joints:
                self._engine.resetJointState(self._body, self._joints[name], angle)
        self._seat()

    def _seat(self) -> None:
        """Puts the torso where ours is, whatever link the file begins with."""
        engine = self._engine
        parent = engine.getJointInfo(self._body, self._joints[_ON_THE_TORSO])[16]
        torso = frame_of(engine, self._body, parent)
        base = engine.getBasePositionAndOrientation(self._body)
        upright = engine.multiplyTransforms(
            TORSO_ORIGIN, (0.0, 0.0, 0.0, 1.0), *engine.invertTransform(*torso)
        )
        engine.resetBasePositionAndOrientation(
            self._body, *engine.multiplyTransforms(*upright, *base)
        )

    def view(
        self,
        nao: Nao,
        game: NDArray[np.uint8],
        width: int,
        height: int,
        viewpoint: ViewName,
        *,
        moved: bool = True,
        turn: float = 0.0,
    ) -> NDArray[np.uint8]:
        """Returns the `Nao.view` of ``nao``, with this robot in the place of ours."""
        place = nao.furniture.screen_place
        if place != self._furniture.screen_place:
            self._furniture.place_screen(*place)
            self._views = self._new_views()
        for name, angle in nao.angles().items():
            self._engine.resetJointState(self._body, self._joints[name], angle)
        self._controller.mimic(nao.controller)
        self._controller.show()
        seen_from = Nao.viewpoints[viewpoint]
        return self._views.picture(seen_from, game, width, height, moved=moved, turn=turn)

    def _new_views(self) -> Views:
        furniture = self._furniture
        return Views(self._engine, furniture.screen, self._screen_shape, furniture.picture_corners)

    def close(self) -> None:
        self._engine.disconnect()


def _load(engine: Any, path: Path) -> int:
    import pybullet

    if not path.is_file():
        raise InputError(f"{path} does not exist: give --nao-urdf your robot's URDF file.")
    check_meshes(path)
    try:
        body: int = engine.loadURDF(
            str(path.resolve()), useFixedBase=True, flags=engine.URDF_IGNORE_COLLISION_SHAPES
        )
    except pybullet.error:
        raise InputError(
            f"{path} cannot be loaded: the engine does not accept it as a URDF file."
        ) from None
    if not engine.getVisualShapeData(body):
        raise InputError(f"{path} shows nothing: it should be a robot with visible parts.")
    return body
