"""Vectors and rotation matrices: x forward, from the robot to the screen; y to its left; z up."""

import math

import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]


def about(axis: Vector, angle: float) -> NDArray[np.float64]:
    """Returns the rotation by ``angle`` (rad) about a unit ``axis``, ``float64 [3, 3]``
    (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: NDArray[np.float64] = (
        np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)
    )
    return turned


def from_roll_pitch_yaw(turn: Vector) -> NDArray[np.float64]:
    """Returns the rotation about the fixed x, then y, then z axis, as URDF defines it."""
    roll, pitch, yaw = turn
    matrix: NDArray[np.float64] = (
        about((0, 0, 1), yaw) @ about((0, 1, 0), pitch) @ about((1, 0, 0), roll)
    )
    return matrix


def to_roll_pitch_yaw(matrix: NDArray[np.float64]) -> Vector:
    """Returns roll, pitch and yaw in rad, the inverse of `from_roll_pitch_yaw`; pitch within
    ±π/2."""
    sine = float(np.clip(-matrix[2, 0], -1.0, 1.0))
    if abs(sine) > 1.0 - 1e-12:
        # Gimbal lock: only the difference of roll and yaw is defined, so it is all yaw.
        yaw = math.atan2(-matrix[0, 1], matrix[1, 1])
        return (0.0, math.asin(sine), yaw)
    return (
        math.atan2(matrix[2, 1], matrix[2, 2]),
        math.asin(sine),
        math.atan2(matrix[1, 0], matrix[0, 0]),
    )
