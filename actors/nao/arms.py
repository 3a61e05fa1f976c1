"""Both arms: from the keys that are wanted to motor commands, frame by frame.

The left hand serves the directions, the right one fire. Poses come from inverse kinematics when
the room is built. Between two places a fingertip is lifted over the keys and led on the way by
one target per emulator frame, as NAO's own motor loop is fed; the motors then do what their
published torques and speeds allow.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.nao.controller import CROSS_MIDDLE, Controller, place_of
from actors.nao.kinematics import ArmChain
from actors.nao.posture import FINGERTIP_RADIUS
from common.actions import KEYS_OF_ACTION, Keys

HOVER = 0.0015
"""m between a resting fingertip and the keys."""
PUSH = 0.0032
"""m that a fingertip pushes a key down: beyond its threshold, short of its stop."""
SWING = 0.5
POSITION_GAIN = 0.35
VELOCITY_GAIN = 1.0

_DIRECTIONS = Keys.UP | Keys.DOWN | Keys.LEFT | Keys.RIGHT
_COMFORTABLE = np.array([1.15, 0.1, -1.25, -1.2])

Angles = NDArray[np.float64]


@dataclass(frozen=True)
class _Poses:
    """Joint angles ``[4]`` of one arm over and on each place that it serves."""

    over: dict[Keys, Angles]
    on: dict[Keys, Angles]


class Arm:
    """One arm in a physics client: a path of targets, one per emulator frame."""

    def __init__(
        self,
        engine: Any,
        body: int,
        side: str,
        controller: Controller,
        places: dict[Keys, tuple[float, float]],
    ) -> None:
        self._engine = engine
        self._drive = engine.setJointMotorControl2
        self._mode = engine.POSITION_CONTROL
        self._body = body
        chain = ArmChain(side)
        names = [
            engine.getJointInfo(body, joint)[1].decode()
            for joint in range(engine.getNumJoints(body))
        ]
        self.joints = [names.index(joint.name) for joint in chain.joints]
        self._speeds = [joint.max_speed for joint in chain.joints]
        self._torques = [joint.max_torque for joint in chain.joints]
        self._chain = chain
        self._controller = controller
        mirror = np.array([1.0, 1.0, 1.0, 1.0] if side == "L" else [1.0, -1.0, -1.0, -1.0])
        start = _COMFORTABLE * mirror
        self.poses = self._solve(places, start)
        self._wanted = Keys.NONE
        self._path: list[Angles] = []

    def _solve(self, places: dict[Keys, tuple[float, float]], start: Angles) -> _Poses:
        over: dict[Keys, Angles] = {}
        on: dict[Keys, Angles] = {}
        for keys, place in places.items():
            above = self._controller.point(place, FINGERTIP_RADIUS + HOVER)
            over[keys] = self._chain.reach(above, start)
            if keys:
                below = self._controller.point(place, FINGERTIP_RADIUS - PUSH)
                on[keys] = self._chain.reach(below, over[keys])
        return _Poses(over, on)

    def want(self, keys: Keys) -> None:
        """Plan the way to ``keys`` (or to rest, for none)."""
        if keys == self._wanted:
            return
        old, self._wanted = self._wanted, keys
        over = self.poses.over
        if keys == Keys.NONE:
            self._path = [over[old], over[Keys.NONE]]
        elif old == Keys.NONE:
            self._path = [over[keys], self.poses.on[keys]]
        else:
            on = self.poses.on
            between = (over[old] + over[keys]) / 2
            lift = between - (on[old] + on[keys]) / 2
            self._path = [between + SWING * lift, over[keys], on[keys]]

    def advance(self) -> None:
        """Give the motors this frame's target; call it before each emulator frame's physics."""
        if not self._path:
            return
        target = self._path.pop(0)
        for joint, angle, torque, speed in zip(
            self.joints, target, self._torques, self._speeds, strict=True
        ):
            self._drive(
                self._body, joint, self._mode, targetPosition=angle,
                force=torque, maxVelocity=speed, positionGain=POSITION_GAIN,
                velocityGain=VELOCITY_GAIN,
            )  # fmt: skip

    def settle(self) -> None:
        """At rest over the keys, without motion."""
        pose = self.poses.over[Keys.NONE]
        for joint, angle in zip(self.joints, pose, strict=True):
            self._engine.resetJointState(self._body, joint, angle, 0.0)
        self._wanted = Keys.NONE
        self._path = [pose]
        self.advance()


class Arms:
    """Both arms together: keys that are wanted in, motor targets out."""

    def __init__(self, engine: Any, body: int, controller: Controller) -> None:
        directions = {
            keys: place_of(keys) for keys in KEYS_OF_ACTION if keys and keys & _DIRECTIONS == keys
        }
        self.left = Arm(engine, body, "L", controller, {**directions, Keys.NONE: CROSS_MIDDLE})
        fire = place_of(Keys.FIRE)
        self.right = Arm(engine, body, "R", controller, {Keys.NONE: fire, Keys.FIRE: fire})

    def command(self, keys: Keys) -> None:
        """Set out for exactly ``keys``; `advance` leads the arms there."""
        self.left.want(keys & _DIRECTIONS)
        self.right.want(keys & Keys.FIRE)

    def advance(self) -> None:
        """Give the motors the targets of one emulator frame."""
        self.left.advance()
        self.right.advance()

    def settle(self) -> None:
        """Both hands at rest over the keys."""
        self.left.settle()
        self.right.settle()
