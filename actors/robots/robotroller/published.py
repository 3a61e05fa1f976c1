"""Published values of the Robotroller of Physical Atari and of its servos.

Positions, gain and servos: Keen Technologies, repository physical-atari-rlc, README.md and
``agent_code/physical_atari_configs/robotroller.default.json``. Servo: Robotis, e-manual of the
DYNAMIXEL XC330-M288-T. The repository only says XC330. Its guard against currents above 1.2 A
leaves the two kinds for 5 V, of which this one is the slower. Nothing else is theirs: the size and
shape of our robot are our own.
"""

import math

TICKS = 4_096
"""Positions of a servo per revolution."""

MIDDLE = 2_030
"""Position, in ticks, of both joystick servos at rest; the constants below are those that press."""
LEFT, RIGHT = 1_905, 2_105
DOWN, UP = 1_925, 2_130
BUTTON_REST, BUTTON_PRESSED = 2_000, 1_940

POSITION_GAIN = 4_500 / 128
"""Units of PWM per tick of position error; the servo's register holds 128 times the gain."""
FULL_PWM = 885
"""Units of PWM at full voltage."""

NO_LOAD_SPEED = 81 * 2 * math.pi / 60
"""Speed of a servo at 5 V without load, rad/s."""
STALL_TORQUE = 0.93
"""Torque of a stalled servo at 5 V, N·m."""
GEAR_RATIO = 288.35
SERVO_MASS = 0.023
SERVO_EDGES = (0.020, 0.034, 0.026)
"""kg, and width, height and depth, m."""


def turned(position: int, rest: int) -> float:
    """Returns the angle between two positions, rad, not negative."""
    return abs(position - rest) * 2 * math.pi / TICKS
