"""Forward and inverse kinematics of an arm.

Four joints position a fingertip in three dimensions, so inverse kinematics takes the solution
nearest to a comfortable posture. The chain is built from the published tables and not read from the
engine: poses need no running physics, and tests compare the two.
"""

import numpy as np
from numpy.typing import NDArray

from actors.robots.nao.anatomy import JOINT_NAMED
from actors.robots.nao.assembly import place_in_piece
from actors.robots.nao.posture import ARM_JOINTS, FINGERTIP_IN_HAND, TORSO_ORIGIN
from actors.robots.room.rotation import Vector, about

_STEPS = 200
_DAMPING = 1e-3
_COMFORT = 0.1
_STILL = 1e-7


class OutOfReach(ValueError):
    """Inverse kinematics found no joint angles within the limits for the point."""


class ArmChain:
    """One arm from the torso to its fingertip; ``side`` is "L" or "R"."""

    def __init__(self, side: str) -> None:
        self.joints = tuple(JOINT_NAMED[side + name] for name in ARM_JOINTS)
        self.lower = np.array([joint.lower for joint in self.joints])
        self.upper = np.array([joint.upper for joint in self.joints])
        piece, turn, origin = place_in_piece(f"{side.lower()}_hand")
        assert piece == self.joints[-1].child
        x, y, z = FINGERTIP_IN_HAND
        tip: Vector = (x, y if side == "L" else -y, z)
        self._tip = origin + turn @ np.array(tip)

    def fingertip(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the fingertip's centre in the room, ``float64 [3]`` in m, for ``angles [4]``."""
        return self._walk(angles)[0]

    def jacobian(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the fingertip's motion per joint angle, ``float64 [3, 4]`` in m/rad."""
        return self._walk(angles)[1]

    def reach(self, point: NDArray[np.float64], start: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns angles ``[4]`` within the limits that bring the fingertip to ``point`` (0.01 mm).

        The search is damped least squares from ``start``, with a pull towards ``start`` in the null
        space (Buss 2004, section 6).

        Raises:
            OutOfReach: the search did not converge to ``point``.
        """
        angles = np.clip(start, self.lower, self.upper)
        for _ in range(_STEPS):
            tip, jacobian = self._walk(angles)
            damped = jacobian @ jacobian.T + _DAMPING**2 * np.eye(3)
            inverse = jacobian.T @ np.linalg.inv(damped)
            null = np.eye(len(angles)) - inverse @ jacobian
            step = inverse @ (point - tip) + null @ (_COMFORT * (start - angles))
            before = angles
            angles = np.clip(angles + step, self.lower, self.upper)
            if np.abs(angles - before).max() < _STILL:
                break
        miss = float(np.linalg.norm(self.fingertip(angles) - point))
        if miss > 1e-5:
            raise OutOfReach(
                f"the fingertip stays {miss * 1000:.2f} mm from {point.tolist()}: choose a point "
                "within the arm's reach."
            )
        return angles

    def _walk(self, angles: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns the fingertip ``[3]`` and its Jacobian ``[3, 4]``."""
        turn, origin = np.eye(3), np.array(TORSO_ORIGIN)
        axes, origins = [], []
        for joint, angle in zip(self.joints, angles, strict=True):
            origin = origin + turn @ np.array(joint.origin)
            axes.append(turn @ np.array(joint.axis))
            origins.append(origin)
            turn = turn @ about(joint.axis, float(angle))
        tip = origin + turn @ self._tip
        columns = [np.cross(axis, tip - at) for axis, at in zip(axes, origins, strict=True)]
        return tip, np.array(columns).T
