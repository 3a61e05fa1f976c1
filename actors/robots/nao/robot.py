"""NAO on a chair at a desk with the controller, in front of the projection screen."""

from pathlib import Path

import numpy as np

from actors.robots.nao.anatomy import TOP_CAMERA_ORIGIN, TOP_CAMERA_PITCH
from actors.robots.nao.arms import Arms
from actors.robots.nao.assembly import place_in_piece, write_nao
from actors.robots.nao.controller import Controller
from actors.robots.nao.posture import HIP_HEIGHT, TORSO_ORIGIN
from actors.robots.room.camera import Mount
from actors.robots.room.engine import angles_of, fixed_body
from actors.robots.room.furniture import DESK_TOP, METAL, Box, Rgba
from actors.robots.room.room import Room
from actors.robots.room.viewpoint import VISITOR, Viewpoint

_, _POSTURE, _NECK = place_in_piece("head")

_BLUE: Rgba = (0.20, 0.38, 0.52, 1.0)
_SEAT = HIP_HEIGHT - 0.037
_LEG = _SEAT - 0.024

_CHAIR: list[Box] = [
    ((-0.015, 0.0, _SEAT - 0.012), (0.170, 0.200, 0.024), _BLUE),
    ((-0.095, 0.0, _SEAT + 0.135), (0.018, 0.180, 0.130), _BLUE),
    *(((-0.095, y, _SEAT + 0.035), (0.012, 0.014, 0.090), METAL) for y in (-0.07, 0.07)),
    *(
        ((x, y, _LEG / 2), (0.014, 0.014, _LEG), METAL)
        for x in (-0.090, 0.060)
        for y in (-0.090, 0.090)
    ),
]


class Nao(Room):
    """NAO, which presses the controller's keys with its fingertips and sees through the camera in
    its forehead."""

    mount = Mount(
        np.array(TORSO_ORIGIN) + _NECK, _POSTURE, TOP_CAMERA_ORIGIN, pitch=TOP_CAMERA_PITCH
    )
    viewpoints = {  # noqa: RUF012
        "room": VISITOR,
        "hands": Viewpoint((0.46, -0.12, 0.46), (0.185, 0.0, 0.222), 30.0),
        "front": Viewpoint((0.66, -0.32, 0.72), (0.075, 0.0, 0.272), 34.0),
    }
    own_furniture = _CHAIR
    arms: Arms
    controller: Controller

    def _build(self, folder: Path) -> None:
        engine = self._engine
        self.body, joints = fixed_body(engine, write_nao(folder), TORSO_ORIGIN)
        for link in joints.values():
            engine.changeDynamics(self.body, link, linearDamping=0.0, angularDamping=0.0)
        self.controller = Controller(engine, folder, DESK_TOP)
        self.arms = Arms(engine, self.body, self.controller)

    def angles(self) -> dict[str, float]:
        """Returns the angle of each moving joint, rad, by joint name."""
        return angles_of(self._engine, self.body)
