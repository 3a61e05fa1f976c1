"""The joystick: a stick on a spring over four switches, and a round button.

The stick leans in two hinges that cross at its foot, `left_right` and then `up_down`. A switch
closes when the stick leans far enough to its side, so a diagonal closes two. Only contact leans the
stick or pushes the button.
"""

import math
from pathlib import Path
from typing import Any

from actors.robots.room.body import KEY_PRESSED, KEY_RELEASED, Pressed
from actors.robots.room.engine import fixed_body
from actors.robots.room.rotation import Vector
from actors.robots.room.shapes import Colour, Shape, ball, rod
from actors.robots.room.urdf import Joint, Part, weighed, write_urdf
from common.actions import Keys

CENTRE: Vector = (0.205, 0.0, 0.0)
"""Centre of the box on top of the desk."""
BOX: Vector = (0.090, 0.090, 0.034)
FOOT = 0.030
"""Height above the desk of the point about which the stick leans, m."""
KNOB_HEIGHT = 0.060
"""Height of the knob's middle above the foot, m."""
KNOB_RADIUS = 0.008

PRESS_LEAN = math.radians(4.0)
RELEASE_LEAN = math.radians(3.0)
"""Hysteresis, rad: a switch is closed from `PRESS_LEAN` on until the stick is back at
`RELEASE_LEAN`."""
MAX_LEAN = math.radians(13.0)
"""Lean at which the stick meets the box, rad."""
SPRING_TORQUE = 0.04
"""Torque that brings the stick back to the middle, N·m: 0.7 N at the knob."""

BUTTON: Vector = (0.031, 0.031, BOX[2] + 0.003)
"""Middle of the released button's cap above the desk, from the box's centre, m."""
BUTTON_CAP = 0.010
"""Height of the cap, m."""
BUTTON_TOP = BUTTON[2] + BUTTON_CAP / 2
BUTTON_TRAVEL = 0.003
PRESS_DEPTH, RELEASE_DEPTH = 0.0014, 0.0008
"""Hysteresis of the button, m."""
BUTTON_FORCE = 0.8
"""Force that pushes the button up, N."""

_BUTTON_RADIUS = 0.009
_CONTACT_DISTANCE = 0.001
"""Distance, m, at which the engine starts to solve a contact."""
_LAMP: Vector = (0.010, 0.010, 0.001)
_LAMP_OUT = 0.039

_BLACK: Colour = (0.09, 0.09, 0.10)
_RUBBER: Colour = (0.16, 0.16, 0.17)
_RED: Colour = (0.78, 0.12, 0.08)
_RELEASED = (*_RED, 1.0)

SIDES: dict[Keys, tuple[int, int]] = {
    Keys.UP: (0, 1),
    Keys.DOWN: (0, -1),
    Keys.LEFT: (1, 0),
    Keys.RIGHT: (-1, 0),
}
"""Signs of the two hinges' angles, `left_right` and `up_down`, where the stick leans to a side."""

LEFT_RIGHT: Vector = (-1.0, 0.0, 0.0)
UP_DOWN: Vector = (0.0, 1.0, 0.0)
"""Axes about which a positive angle leans to the left, and away from the robot."""


class Joystick(Pressed):
    """The joystick in a physics client; ``desk_top`` is the height of the desk, m."""

    press_depths = (PRESS_LEAN,) * len(SIDES) + (PRESS_DEPTH,)
    release_depths = (RELEASE_LEAN,) * len(SIDES) + (RELEASE_DEPTH,)

    def __init__(self, engine: Any, folder: Path, desk_top: float) -> None:
        file = write_urdf(folder, "joystick", _PARTS, _JOINTS)
        body, numbers = fixed_body(engine, file, (CENTRE[0], CENTRE[1], desk_top))
        super().__init__(engine, body, {numbers[joint.name]: joint.max_torque for joint in _JOINTS})
        for link in range(-1, len(numbers)):
            engine.changeDynamics(
                self.body, link, lateralFriction=0.0, restitution=0.0, jointDamping=0.0,
                linearDamping=0.0, angularDamping=0.0,
                contactProcessingThreshold=_CONTACT_DISTANCE,
            )  # fmt: skip
        moving = zip(self._joints[1:], (_STICK, _CAP), strict=True)
        self.movables = [(link, part.extent) for link, part in moving]

    def _depths(self) -> tuple[float, ...]:
        left, away, down = (state[0] for state in self._states(self.body, self._joints))
        return away, -away, left, -left, down

    def _paint(self, key: Keys, *, pressed: bool) -> None:
        """Lights the lamp of a switch, or colours the button."""
        if key is Keys.FIRE:
            colour = KEY_PRESSED if pressed else _RELEASED
            self._engine.changeVisualShape(self.body, self._joints[2], rgbaColor=colour)
        else:
            lamp = len(_BASE.shapes) - len(SIDES) + list(SIDES).index(key)
            colour = KEY_PRESSED if pressed else KEY_RELEASED
            self._engine.changeVisualShape(self.body, -1, shapeIndex=lamp, rgbaColor=colour)


_BASE = weighed(
    "base",
    (Shape("box", BOX, (0.0, 0.0, BOX[2] / 2), _BLACK), 0.15),
    (rod(0.020, 0.004, (0.0, 0.0, BOX[2] + 0.002), _RUBBER), 0.01),
    *(
        (
            Shape("box", _LAMP, (away * _LAMP_OUT, left * _LAMP_OUT, BOX[2]), KEY_RELEASED[:3]),
            0.001,
        )
        for left, away in SIDES.values()
    ),
)
_CROSS = weighed("cross", (ball(0.004, (0.0, 0.0, 0.0), _BLACK), 0.004))
_STICK = weighed(
    "stick",
    (rod(0.0055, 0.050, (0.0, 0.0, 0.030), _RUBBER), 0.010),
    (rod(0.0065, 0.014, (0.0, 0.0, KNOB_HEIGHT + 0.014), _RUBBER), 0.003),
    (ball(KNOB_RADIUS, (0.0, 0.0, KNOB_HEIGHT), _RUBBER, solid=True), 0.007),
)
# The button is drawn round and touched as the square within: the engine rounds cylinders off.
_CAP = weighed(
    "cap",
    (rod(_BUTTON_RADIUS, BUTTON_CAP, (0.0, 0.0, 0.0002), _RED), 0.003),
    (Shape("box", (0.012, 0.012, BUTTON_CAP), (0.0, 0.0, 0.0), _RED, solid=True), 0.001),
)
_PARTS: tuple[Part, ...] = (_BASE, _CROSS, _STICK, _CAP)
_JOINTS = (
    Joint("left_right", "base", "cross", (0.0, 0.0, FOOT), LEFT_RIGHT,
          -MAX_LEAN, MAX_LEAN, 50.0, SPRING_TORQUE),
    Joint("up_down", "cross", "stick", (0.0, 0.0, 0.0), UP_DOWN,
          -MAX_LEAN, MAX_LEAN, 50.0, SPRING_TORQUE),
    Joint("fire", "base", "cap", BUTTON, (0.0, 0.0, -1.0),
          0.0, BUTTON_TRAVEL, 10.0, BUTTON_FORCE, "prismatic"),
)  # fmt: skip
