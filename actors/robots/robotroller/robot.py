"""The Robotroller on the desk, with a joystick to lean and a camera on a tripod behind it."""

from pathlib import Path

import numpy as np

from actors.robots.robotroller.arm import Arm
from actors.robots.robotroller.joystick import Joystick
from actors.robots.room.camera import Mount
from actors.robots.room.furniture import DESK_TOP, METAL, Box
from actors.robots.room.room import Room
from actors.robots.room.rotation import about
from actors.robots.room.viewpoint import VISITOR, Viewpoint

_HEAD = (0.0, 0.0, 0.445)
_LENS = (0.05, 0.0, 0.02)
_TILT = -0.085
"""Pitch of the camera, rad: it looks up a little, over the arm, at the middle of the screen."""

_TRIPOD: list[Box] = [
    ((0.0, 0.0, 0.22), (0.016, 0.016, 0.44), METAL),
    ((0.0, 0.0, 0.01), (0.20, 0.02, 0.02), METAL),
    ((0.0, 0.0, 0.01), (0.02, 0.20, 0.02), METAL),
    ((0.012, 0.0, 0.462), (0.046, 0.060, 0.044), (0.12, 0.12, 0.14, 1.0)),
]


class Robotroller(Room):
    """Three servos that lean an Atari joystick and push its button, and a camera on a tripod that
    sees the screen from where NAO's eye would be."""

    mount = Mount(np.array(_HEAD), about((0.0, 1.0, 0.0), _TILT), _LENS, pitch=0.0)
    viewpoints = {  # noqa: RUF012
        "room": VISITOR,
        "hands": Viewpoint((0.43, -0.20, 0.44), (0.205, 0.005, 0.245), 30.0),
        "front": Viewpoint((0.62, -0.36, 0.56), (0.13, 0.0, 0.30), 42.0),
    }
    own_furniture = _TRIPOD

    arms: Arm
    controller: Joystick

    def _build(self, folder: Path) -> None:
        self.controller = Joystick(self._engine, folder, DESK_TOP)
        self.arms = Arm(self._engine, folder, DESK_TOP)
