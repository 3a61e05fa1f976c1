"""Posture of the seated robot: moving joints, angles of the held joints, position in the room.

The head is tilted up a little, so that the camera sees the whole screen and nothing of the arms.
The wrists are turned so that the fingers point down when the forearms are level.
"""

import math

from actors.robots.nao.anatomy import SOLE_BELOW_ANKLE
from actors.robots.room.rotation import Vector

ARM_JOINTS: tuple[str, ...] = ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll")
"""Names of each arm's moving joints, without the side, from the shoulder outwards."""

_THIGH_TILT = 1.5
HELD_ANGLES: dict[str, float] = {
    "HeadYaw": 0.0,
    "HeadPitch": -0.14,
    "LWristYaw": math.pi / 2,
    "RWristYaw": -math.pi / 2,
    "LHipYawPitch": 0.0,
    "RHipYawPitch": 0.0,
    "LHipPitch": -_THIGH_TILT,
    "RHipPitch": -_THIGH_TILT,
    "LKneePitch": _THIGH_TILT,
    "RKneePitch": _THIGH_TILT,
    "LAnklePitch": 0.0,
    "RAnklePitch": 0.0,
}
"""Angles of the joints that do not move, rad."""

KNEE_HEIGHT = 0.1029 + SOLE_BELOW_ANKLE
HIP_HEIGHT = KNEE_HEIGHT + 0.1 * math.cos(_THIGH_TILT)
TORSO_ORIGIN: Vector = (0.0, 0.0, HIP_HEIGHT + 0.085)
"""Position of the torso's frame in the room, with the soles on the floor, m."""

FINGERTIP_IN_HAND: Vector = (0.098, 0.0, -0.042)
"""Centre of the ball at the pointing finger's end, in the hand's frame."""
FINGERTIP_RADIUS = 0.005
