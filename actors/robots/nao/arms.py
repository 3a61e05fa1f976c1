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

from actors.robots.nao.controller import CROSS_MIDDLE, Controller, place_of
from actors.robots.nao.kinematics import ArmChain
from actors.robots.nao.posture import FINGERTIP_RADIUS
from common.actions import KEYS_OF_ACTION, Keys

HOVER = 0.0015
"""m between a resting fingertip and the keys."""
PUSH = 0.0032
"""m that a fingertip pushes a key down: beyond its threshold, short of its stop."""
SWING = 0.5
"""How much higher than at rest a fingertip goes on its way between keys, against the height
from pushing to rest."""
NEAR_ENOUGH = 0.006
"""m beside its place from which a fingertip may start to go down: it still has that way to go
before it touches."""
SETTLED = 4
"""Frames after which the arm has reached a waypoint."""
PATIENCE = 12
"""Frames after which a fingertip that is not at its place is taken for caught."""
POSITION_GAIN = 0.35
"""Share of its error that a joint's motor wants to make good in a physics step. More overshoots
with the published torques, less is late."""
VELOCITY_GAIN = 1.0
SPEED_MARGIN = 0.9
"""Share of its greatest speed that a motor is asked for: the engine keeps limits only nearly."""

_DIRECTIONS = Keys.UP | Keys.DOWN | Keys.LEFT | Keys.RIGHT
_COMFORTABLE = np.array([1.15, 0.1, -1.25, -1.2])

Angles = NDArray[np.float64]


@dataclass(frozen=True)
class _Poses:
    """Joint angles ``[4]`` of one arm over and on each place that it serves."""

    over: dict[Keys, Angles]
    on: dict[Keys, Angles]
    jacobian: dict[Keys, NDArray[np.float64]]
    """``[3, 4]``: how the fingertip over a place moves with the joints."""
    lift: Angles
    """From on to over, the mean of all places."""


@dataclass(frozen=True)
class _Waypoint:
    target: Angles
    over: Angles
    """The hovering pose at the same place."""
    down: bool = False


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
        self._states = engine.getJointStates
        self._mode = engine.POSITION_CONTROL
        self._body = body
        self.chain = chain = ArmChain(side)
        names = [
            engine.getJointInfo(body, joint)[1].decode()
            for joint in range(engine.getNumJoints(body))
        ]
        self.joints = [names.index(joint.name) for joint in chain.joints]
        self._speeds = [SPEED_MARGIN * joint.max_speed for joint in chain.joints]
        self._torques = [joint.max_torque for joint in chain.joints]
        self._controller = controller
        mirror = np.array([1.0, 1.0, 1.0, 1.0] if side == "L" else [1.0, -1.0, -1.0, -1.0])
        start = _COMFORTABLE * mirror
        self.poses = self._solve(places, start)
        self._wanted = Keys.NONE
        self._path: list[_Waypoint] = []
        self._over = self.poses.over[Keys.NONE]
        self._down = False
        self._still = 0

    def _solve(self, places: dict[Keys, tuple[float, float]], start: Angles) -> _Poses:
        over: dict[Keys, Angles] = {}
        on: dict[Keys, Angles] = {}
        for keys, place in places.items():
            above = self._controller.point(place, FINGERTIP_RADIUS + HOVER)
            over[keys] = self.chain.reach(above, start)
            if keys:
                below = self._controller.point(place, FINGERTIP_RADIUS - PUSH)
                on[keys] = self.chain.reach(below, over[keys])
        jacobian = {keys: self.chain.jacobian(pose) for keys, pose in over.items()}
        lift = np.mean([over[keys] - on[keys] for keys in on], axis=0)
        return _Poses(over, on, jacobian, lift)

    def want(self, keys: Keys) -> None:
        """Plan the way to ``keys`` (or to rest, for none), from wherever the hand is now."""
        if keys == self._wanted:
            return
        self._wanted = keys
        goal = self.poses.over[keys]
        self._path = [_Waypoint(goal, goal)]
        if self._down or self._still < SETTLED:
            # Up first, and then over the keys a little higher than at rest.
            between = (self._over + goal) / 2
            self._path.insert(0, _Waypoint(between + SWING * self.poses.lift, between))
        if keys:
            self._path.append(_Waypoint(self.poses.on[keys], goal, down=True))

    def advance(self) -> None:
        """Give the motors this frame's target; call it before each emulator frame's physics."""
        self._still += 1
        if self._still % PATIENCE == 0 and not self._is_over(self._wanted):
            self._free()
        if not self._path or (self._path[0].down and not self._is_over(self._wanted)):
            return
        waypoint = self._path.pop(0)
        self._over, self._down, self._still = waypoint.over, waypoint.down, 0
        for joint, angle, torque, speed in zip(
            self.joints, waypoint.target, self._torques, self._speeds, strict=True
        ):
            self._drive(
                self._body, joint, self._mode, targetPosition=angle,
                force=torque, maxVelocity=speed, positionGain=POSITION_GAIN,
                velocityGain=VELOCITY_GAIN,
            )  # fmt: skip

    def _free(self) -> None:
        """Plan a high way round: the fingertip got caught on the edge of a key."""
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
        """Whether the fingertip has come near enough above ``keys`` to go down on them."""
        states = self._states(self._body, self.joints)
        missing = self.poses.over[keys] - [state[0] for state in states]
        x, y, _ = self.poses.jacobian[keys] @ missing
        return bool(x * x + y * y < NEAR_ENOUGH**2)

    def place(self, pose: Angles) -> None:
        """Put the joints at ``pose [4]``, rad, without motion."""
        for joint, angle in zip(self.joints, pose, strict=True):
            self._engine.resetJointState(self._body, joint, float(angle), 0.0)

    def settle(self) -> None:
        """At rest over the keys, without motion."""
        pose = self.poses.over[Keys.NONE]
        self.place(pose)
        self._wanted = Keys.NONE
        self._path = [_Waypoint(pose, pose)]
        self.advance()
        self._still = SETTLED


class Arms:
    """Both arms together: keys that are wanted in, motor targets out."""

    def __init__(self, engine: Any, body: int, controller: Controller) -> None:
        directions = {
            keys: place_of(keys) for keys in KEYS_OF_ACTION if keys and keys & _DIRECTIONS == keys
        }
        self.left = Arm(engine, body, "L", controller, {**directions, Keys.NONE: CROSS_MIDDLE})
        fire = place_of(Keys.FIRE)
        self.right = Arm(engine, body, "R", controller, {Keys.NONE: fire, Keys.FIRE: fire})
        self._states = engine.getJointStates
        self._body = body
        self._joints = [*self.left.joints, *self.right.joints]
        joints = [*self.left.chain.joints, *self.right.chain.joints]
        self._middles = np.array([(joint.lower + joint.upper) / 2 for joint in joints])
        self._ranges = np.array([(joint.upper - joint.lower) / 2 for joint in joints])
        self._top_speeds = np.array([joint.max_speed for joint in joints])

    def posture(self) -> tuple[Angles, Angles]:
        """Of both arms' joints, left first, the angles between their limits (-1 to 1) and the
        speeds as shares of their greatest, ``float64 [8]`` each."""
        states = self._states(self._body, self._joints)
        angles, speeds = np.array([state[:2] for state in states]).T
        return (angles - self._middles) / self._ranges, speeds / self._top_speeds

    def angles(self) -> dict[str, float]:
        """The angle of each joint that moves, rad, by the joint's name."""
        states = self._states(self._body, self._joints)
        return {
            joint.name: float(state[0])
            for joint, state in zip(
                (*self.left.chain.joints, *self.right.chain.joints), states, strict=True
            )
        }

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
