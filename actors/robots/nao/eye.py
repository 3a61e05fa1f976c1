"""The camera in NAO's forehead."""

import numpy as np

from actors.robots.nao.anatomy import TOP_CAMERA_ORIGIN, TOP_CAMERA_PITCH
from actors.robots.nao.assembly import place_in_piece
from actors.robots.nao.posture import TORSO_ORIGIN
from actors.robots.room.camera import Mount

_, _POSTURE, _NECK = place_in_piece("head")

TOP_CAMERA = Mount(
    np.array(TORSO_ORIGIN) + _NECK, _POSTURE, TOP_CAMERA_ORIGIN, pitch=TOP_CAMERA_PITCH
)
