"""The arm: two servos in a gimbal whose arch leans the joystick, and one with a finger for fire.

The axes of both gimbal servos cross at the stick's foot. The first turns the ring to the left and
right; the second, on the ring, turns the arch away and back. At the arch's top a square socket
holds the stick's knob with a little play. A servo turns at full speed until it is near its goal.
"""

import math
from pathlib import Path
from typing import Any

from actors.robots.robotroller import published
from actors.robots.robotroller.joystick import (
    BUTTON,
    BUTTON_TOP,
    CENTRE,
    FOOT,
    KNOB_HEIGHT,
    KNOB_RADIUS,
    LEFT_RIGHT,
    SIDES,
    UP_DOWN,
)
from actors.robots.robotroller.published import NO_LOAD_SPEED, STALL_TORQUE, turned
from actors.robots.room.body import Limbs
from actors.robots.room.engine import fixed_body
from actors.robots.room.room import PHYSICS_RATE
from actors.robots.room.rotation import Vector
from actors.robots.room.shapes import ALONG_X, ALONG_Y, Colour, Shape, ball, rod
from actors.robots.room.urdf import Joint, Part, weighed, write_urdf
from common.actions import Keys

PLAY = 0.0002
"""Gap between knob and socket on each side, m."""
FINGER_LENGTH = 0.0536
"""Length of the finger from its axis to its tip, m; that of the published part."""
TIP_RADIUS = 0.004
HOVER = 0.0024
"""Height of the resting fingertip over the released button, m."""
ROTOR_INERTIA = 1.2e-8
"""Inertia of a servo's rotor, kg·m², estimated from other coreless motors of its size. Behind the
gear it is ten times the inertia of what the servo turns."""
MAX_TURN = math.radians(12.5)
"""Greatest angle of each servo from its rest, rad: beyond all of the published positions."""

LEANS: dict[Keys, float] = {
    Keys.UP: turned(published.UP, published.MIDDLE),
    Keys.DOWN: -turned(published.DOWN, published.MIDDLE),
    Keys.LEFT: turned(published.LEFT, published.MIDDLE),
    Keys.RIGHT: -turned(published.RIGHT, published.MIDDLE),
    Keys.FIRE: turned(published.BUTTON_PRESSED, published.BUTTON_REST),
}
"""Angle of the key's servo that presses it, rad."""

_RING = 0.064
"""Half of the ring's edge, m; it goes round the joystick's box."""
_ARCH = 0.058
_WALL = 0.004
_AXIS: Vector = (0.0, 0.0, FOOT)

_WHITE: Colour = (0.93, 0.93, 0.95)
_ORANGE: Colour = (0.98, 0.45, 0.08)
_SERVO: Colour = (0.13, 0.13, 0.15)
_METAL: Colour = (0.62, 0.64, 0.68)


class Arm(Limbs):
    """Three servos in a physics client."""

    def __init__(self, engine: Any, folder: Path, desk_top: float) -> None:
        file = write_urdf(folder, "robotroller", _PARTS, _JOINTS)
        body, numbers = fixed_body(engine, file, (CENTRE[0], CENTRE[1], desk_top))
        joints = {numbers[joint.name]: joint for joint in _JOINTS}
        super().__init__(engine, body, joints, {part.name: part for part in _PARTS})
        for link in range(-1, len(numbers)):
            engine.changeDynamics(
                body, link, lateralFriction=0.0, jointDamping=0.0,
                linearDamping=0.0, angularDamping=0.0,
            )  # fmt: skip
        for link, axis in zip(joints, (0, 1, 0), strict=True):
            # Set here, because the engine refuses a file with so much inertia about one axis only.
            inertia = list(engine.getDynamicsInfo(body, link)[2])
            inertia[axis] += ROTOR_INERTIA * published.GEAR_RATIO**2
            engine.changeDynamics(body, link, localInertiaDiagonal=inertia)
        self._goals = (0.0, 0.0, 0.0)
        self._given: tuple[float, float, float] | None = None
        self.limit_speed(1.0)

    def limit_speed(self, share: float) -> None:
        self._speed = share * NO_LOAD_SPEED

    def command(self, keys: Keys) -> None:
        self._goals = _GOALS[keys]

    def advance(self) -> None:
        if self._goals == self._given:
            return
        self._given = self._goals
        for joint, goal in zip(self.joints, self._goals, strict=True):
            self._engine.setJointMotorControl2(
                self.body, joint, self._engine.POSITION_CONTROL, targetPosition=goal,
                force=STALL_TORQUE, maxVelocity=self._speed, positionGain=_POSITION_GAIN,
                velocityGain=1.0,
            )  # fmt: skip

    def settle(self) -> None:
        for joint in self.joints:
            self._engine.resetJointState(self.body, joint, 0.0, 0.0)
        self._goals, self._given = (0.0, 0.0, 0.0), None
        self.advance()


def _goals(keys: Keys) -> tuple[float, float, float]:
    """Returns the angles of the servos that hold ``keys``: left or right, up or down, fire."""
    left_right, up_down = (
        sum(LEANS[key] for key, signs in SIDES.items() if key & keys and signs[hinge])
        for hinge in (0, 1)
    )
    return left_right, up_down, LEANS[Keys.FIRE] if Keys.FIRE & keys else 0.0


_GOALS = {Keys(bits): _goals(Keys(bits)) for bits in range(32)}

# The servo's own controller gives the full voltage down to this error. The engine's motor corrects
# the share `positionGain` of the error in each physics step, limited by its speed.
_FULL_VOLTAGE_ERROR = published.FULL_PWM / published.POSITION_GAIN * 2 * math.pi / published.TICKS
_POSITION_GAIN = NO_LOAD_SPEED / PHYSICS_RATE / _FULL_VOLTAGE_ERROR


def _servo(middle: Vector, edges: Vector) -> tuple[Shape, float]:
    return Shape("box", edges, middle, _SERVO), published.SERVO_MASS


_WIDE, _TALL, _DEEP = published.SERVO_EDGES
_FINGER_AXIS: Vector = (
    BUTTON[0],
    BUTTON[1] + FINGER_LENGTH,
    BUTTON_TOP + HOVER + TIP_RADIUS,
)
_BASE = weighed(
    "base",
    (Shape("box", (0.191, 0.161, 0.004), (0.0, 0.0, 0.002), _WHITE), 0.10),
    # The servo of left and right, its stand, and the bearing on the far side.
    _servo((-_RING - 0.018, 0.0, FOOT), (_DEEP, _WIDE, _TALL)),
    (Shape("box", (_DEEP, 0.026, 0.012), (-_RING - 0.018, 0.0, 0.008), _ORANGE), 0.01),
    (Shape("box", (0.008, 0.020, FOOT + 0.008), (_RING + 0.010, 0.0, FOOT / 2 + 0.004), _ORANGE),
     0.02),
    # The finger's servo on its post.
    _servo((BUTTON[0] + 0.020, _FINGER_AXIS[1], _FINGER_AXIS[2]), (_DEEP, _TALL, _WIDE)),
    (Shape("box", (0.020, 0.020, _FINGER_AXIS[2] - 0.010),
           (BUTTON[0] + 0.020, _FINGER_AXIS[1] + 0.004, (_FINGER_AXIS[2] - 0.010) / 2), _ORANGE),
     0.02),
)  # fmt: skip
_RING_PART = weighed(
    "ring",
    *((Shape("box", (0.006, 2 * _RING, 0.008), (side * _RING, 0.0, 0.0), _WHITE), 0.008)
      for side in (-1, 1)),
    *((Shape("box", (2 * _RING, 0.006, 0.008), (0.0, side * _RING, 0.0), _WHITE), 0.008)
      for side in (-1, 1)),
    *((rod(0.004, 0.014, (side * (_RING + 0.004), 0.0, 0.0), _METAL, ALONG_X), 0.002)
      for side in (-1, 1)),
    _servo((0.0, -_RING - 0.018, 0.0), (_WIDE, _DEEP, _TALL)),
)  # fmt: skip
_TOP = KNOB_HEIGHT
_HOLE = KNOB_RADIUS + PLAY
_ARCH_PART = weighed(
    "arch",
    *((Shape("box", (0.012, 0.005, _TOP + 0.006), (0.0, side * _ARCH, _TOP / 2), _ORANGE), 0.008)
      for side in (-1, 1)),
    *((Shape("box", (0.012, _ARCH - _HOLE - _WALL, 0.008),
             (0.0, side * (_ARCH + _HOLE + _WALL) / 2, _TOP), _ORANGE), 0.006)
      for side in (-1, 1)),
    *((rod(0.004, 0.016, (0.0, side * (_ARCH + 0.004), 0.0), _METAL, ALONG_Y), 0.002)
      for side in (-1, 1)),
    *((Shape("box", (_WALL, 2 * (_HOLE + _WALL), 0.012),
             (side * (_HOLE + _WALL / 2), 0.0, _TOP), _WHITE, solid=True), 0.002)
      for side in (-1, 1)),
    *((Shape("box", (2 * _HOLE, _WALL, 0.012),
             (0.0, side * (_HOLE + _WALL / 2), _TOP), _WHITE, solid=True), 0.002)
      for side in (-1, 1)),
)  # fmt: skip
_FINGER = weighed(
    "finger",
    (rod(0.008, 0.010, (0.002, 0.0, 0.0), _METAL, ALONG_X), 0.003),
    (Shape("box", (0.008, FINGER_LENGTH, 0.005), (0.0, -FINGER_LENGTH / 2, 0.002), _ORANGE), 0.006),
    (ball(TIP_RADIUS, (0.0, -FINGER_LENGTH, 0.0), _ORANGE, solid=True), 0.001),
)
_PARTS: tuple[Part, ...] = (_BASE, _RING_PART, _ARCH_PART, _FINGER)


def _hinge(name: str, parent: str, child: str, origin: Vector, axis: Vector) -> Joint:
    return Joint(
        name, parent, child, origin, axis, -MAX_TURN, MAX_TURN, NO_LOAD_SPEED, STALL_TORQUE
    )


_JOINTS = (
    _hinge("left_right", "base", "ring", _AXIS, LEFT_RIGHT),
    _hinge("up_down", "ring", "arch", (0.0, 0.0, 0.0), UP_DOWN),
    _hinge("fire", "base", "finger", _FINGER_AXIS, (1.0, 0.0, 0.0)),
)
