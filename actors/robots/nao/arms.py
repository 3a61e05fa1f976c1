"""Control of both arms: turns commanded keys into one motor target per emulator frame.

The left hand presses the directions, the right hand fire. Inverse kinematics gives the poses when
the room is built. Between two keys the arm lifts the fingertip over the other keys. It gets one
target per emulator frame, as NAO's own motor loop does; how fast the motors follow depends on their
published torques and speeds.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.robots.nao.assembly import assemble
from actors.robots.nao.controller import CROSS_MIDDLE, Controller, place_of
from actors.robots.nao.kinematics import ArmChain
from actors.robots.nao.posture import FINGERTIP_RADIUS
from actors.robots.room.body import Limbs
from actors.robots.room.engine import joints_of
from actors.robots.room.rotation import Vector
from common.actions import KEYS_OF_ACTION, Keys

HOVER = 0.0015
"""Height of a resting fingertip above the keys, m."""
PUSH = 0.0032
"""Depth to which a fingertip pushes a key, m: beyond the threshold, short of the stop."""
SWING = 0.5
"""Extra height of a fingertip on its way between keys, as a share of the height from pushing to
rest."""
NEAR_ENOUGH = 0.006
"""Horizontal distance to its target, m, below which a fingertip may start to go down."""
SETTLED = 4
"""Emulator frames after which the arm has reached a waypoint."""
PATIENCE = 12
"""Emulator frames after which a fingertip that is not at its target counts as caught."""
POSITION_GAIN = 0.35
"""Share of a joint's position error that its motor corrects in one physics step. With the published
torques a higher gain overshoots and a lower gain adds latency."""
VELOCITY_GAIN = 1.0
SPEED_MARGIN = 0.9
"""Share of the maximum speed that a motor is given: the engine keeps speed limits only nearly."""

_DIRECTIONS = Keys.UP | Keys.DOWN | Keys.LEFT | Keys.RIGHT
_COMFORTABLE = np.array([1.15, 0.1, -1.25, -1.2])

Angles = NDArray[np.float64]


@dataclass(frozen=True)
class _Poses:
    """Joint angles ``[4]`` of one arm above and on each set of keys that it presses."""

    over: dict[Keys, Angles]
    on: dict[Keys, Angles]
    jacobian: dict[Keys, NDArray[np.float64]]
    """m of fingertip motion per rad of each joint, ``[3, 4]``, at each pose in `over`."""
    lift: Angles
    """Mean difference from `on` to `over`."""


@dataclass(frozen=True)
class _Waypoint:
    target: Angles
    over: Angles
    """The hovering pose above the same keys."""
    down: bool = False


@cache
def _solve(side: str, points: tuple[tuple[Keys, Vector, Vector], ...]) -> _Poses:
    """Returns the poses of a fingertip above and on keys, whose points in the room are given.

    They are the same for all robots of a process, and take longer than to build all else of one.
    """
    chain = ArmChain(side)
    start = _COMFORTABLE * ((1.0, 1.0, 1.0, 1.0) if side == "L" else (1.0, -1.0, -1.0, -1.0))
    over = {keys: chain.reach(np.array(above), start) for keys, above, _ in points}
    on = {keys: chain.reach(np.array(below), over[keys]) for keys, _, below in points if keys}
    jacobian = {keys: chain.jacobian(pose) for keys, pose in over.items()}
    lift = np.mean([over[keys] - on[keys] for keys in on], axis=0)
    return _Poses(over, on, jacobian, lift)


class Arm:
    """One arm in a physics client, led along a path of targets, one per emulator frame."""

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
        self._states = engine.getJointStates
        self._mode = engine.POSITION_CONTROL
        self._body = body
        self.chain = chain = ArmChain(side)
        numbers = joints_of(engine, body)
        self.joints = [numbers[joint.name] for joint in chain.joints]
        self.limit_speed(1.0)
        self._torques = [joint.max_torque for joint in chain.joints]
        # A motor's own limit holds nearly: 1 physics step in 1,600 would be up to 7 % too fast.
        for number, joint in zip(self.joints, chain.joints, strict=True):
            engine.changeDynamics(body, number, maxJointVelocity=joint.max_speed)

        def point(place: tuple[float, float], above: float) -> Vector:
            x, y, z = controller.point(place, FINGERTIP_RADIUS + above).tolist()
            return x, y, z

        self.poses = _solve(
            side,
            tuple((keys, point(at, HOVER), point(at, -PUSH)) for keys, at in places.items()),
        )
        self._wanted = Keys.NONE
        self._path: list[_Waypoint] = []
        self._over = self.poses.over[Keys.NONE]
        self._down = False
        self._still = 0
        """Emulator frames since the motors got their last target."""
        self._waited = 0
        """The same, or since the last command, if that is later."""

    def limit_speed(self, share: float) -> None:
        self._speeds = [share * SPEED_MARGIN * joint.max_speed for joint in self.chain.joints]

    def want(self, keys: Keys) -> None:
        """Plans a path from the present position to ``keys``, or to rest for no keys."""
        if keys == self._wanted:
            return
        self._wanted, self._waited = keys, 0
        goal = self.poses.over[keys]
        self._path = [_Waypoint(goal, goal)]
        if self._down or self._still < SETTLED:
            # Lift first, then cross the keys a little higher than at rest.
            between = (self._over + goal) / 2
            self._path.insert(0, _Waypoint(between + SWING * self.poses.lift, between))
        if keys:
            self._path.append(_Waypoint(self.poses.on[keys], goal, down=True))

    def advance(self) -> None:
        """Sets the motors' target for one emulator frame; call it before that frame's physics."""
        self._still += 1
        self._waited += 1
        if self._waited % PATIENCE == 0 and not self._is_over(self._wanted):
            self._free()
        if not self._path or (self._path[0].down and not self._is_over(self._wanted)):
            return
        waypoint = self._path.pop(0)
        self._over, self._down = waypoint.over, waypoint.down
        self._still = self._waited = 0
        for joint, angle, torque, speed in zip(
            self.joints, waypoint.target, self._torques, self._speeds, strict=True
        ):
            self._drive(
                self._body, joint, self._mode, targetPosition=angle,
                force=torque, maxVelocity=speed, positionGain=POSITION_GAIN,
                velocityGain=VELOCITY_GAIN,
            )  # fmt: skip

    def _free(self) -> None:
        """Plans a higher path: the fingertip is caught on the edge of a key."""
        goal, lift = self.poses.over[self._wanted], self.poses.lift
        here = np.array([state[0] for state in self._states(self._body, self.joints)])
        straight_up = _Waypoint(here + 3.0 * lift, goal)
        self._path = [
            straight_up,
            straight_up,
            _Waypoint(goal + 2.0 * lift, goal),
            _Waypoint(goal, goal),
        ]
        if self._wanted:
            self._path.append(_Waypoint(self.poses.on[self._wanted], goal, down=True))

    def _is_over(self, keys: Keys) -> bool:
        """Whether the fingertip is near enough above ``keys`` to go down on them."""
        states = self._states(self._body, self.joints)
        missing = self.poses.over[keys] - [state[0] for state in states]
        x, y, _ = self.poses.jacobian[keys] @ missing
        return bool(x * x + y * y < NEAR_ENOUGH**2)

    def place(self, pose: Angles) -> None:
        """Sets the joints to ``pose [4]``, rad, at once."""
        for joint, angle in zip(self.joints, pose, strict=True):
            self._engine.resetJointState(self._body, joint, float(angle), 0.0)

    def settle(self) -> None:
        pose = self.poses.over[Keys.NONE]
        self.place(pose)
        self._wanted = Keys.NONE
        self._path = [_Waypoint(pose, pose)]
        self.advance()
        self._still = SETTLED


class Arms(Limbs):
    """Both arms, left first, which follow planned paths."""

    def __init__(self, engine: Any, body: int, controller: Controller) -> None:
        directions = {
            keys: place_of(keys) for keys in KEYS_OF_ACTION if keys and keys & _DIRECTIONS == keys
        }
        self.left = Arm(engine, body, "L", controller, {**directions, Keys.NONE: CROSS_MIDDLE})
        fire = place_of(Keys.FIRE)
        self.right = Arm(engine, body, "R", controller, {Keys.NONE: fire, Keys.FIRE: fire})
        joints = {
            number: joint
            for arm in (self.left, self.right)
            for number, joint in zip(arm.joints, arm.chain.joints, strict=True)
        }
        super().__init__(engine, body, joints, assemble()[0])

    def limit_speed(self, share: float) -> None:
        self.left.limit_speed(share)
        self.right.limit_speed(share)

    def command(self, keys: Keys) -> None:
        self.left.want(keys & _DIRECTIONS)
        self.right.want(keys & Keys.FIRE)

    def advance(self) -> None:
        self.left.advance()
        self.right.advance()

    def settle(self) -> None:
        self.left.settle()
        self.right.settle()
