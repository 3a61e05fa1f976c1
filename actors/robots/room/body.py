"""A robot's body in a room: limbs that move, and the controller whose keys they press."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from actors.robots.room.urdf import Joint, Part
from common.actions import Keys
from common.proprioception import KEYS

KEY_RELEASED = (0.20, 0.21, 0.24, 1.0)
KEY_PRESSED = (0.20, 0.95, 0.35, 1.0)
"""Colours of a key or its lamp, RGBA."""
_KEY_SETS = tuple(map(Keys, range(2 ** len(KEYS))))
"""Every set of keys by its bits: making a `Keys` costs more than reading the controller."""


class Limbs(ABC):
    """Arms or servos, whose motors follow commands.

    Args:
        body: number of the body in the physics client.
        joints: moving joints by their numbers.
        parts: parts of the body by name.
    """

    def __init__(
        self, engine: Any, body: int, joints: Mapping[int, Joint], parts: Mapping[str, Part]
    ) -> None:
        self.body = body
        self.movables = [(link, parts[joint.child].extent) for link, joint in joints.items()]
        """Moving links, each with the radius around its centre of mass that holds all that is drawn
        of it, m."""
        self._engine = engine
        self._states = engine.getJointStates
        self.joints = list(joints)
        """Numbers of the moving joints."""
        lower, upper, self._top_speeds = np.array(
            [(each.lower, each.upper, each.max_speed) for each in joints.values()]
        ).T
        self._middles, self._ranges = (lower + upper) / 2, (upper - lower) / 2

    def posture(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns angles and speeds of the joints; see `Robot.proprioception`."""
        states = self._states(self.body, self.joints)
        angles, speeds = np.array([state[:2] for state in states]).T
        return (angles - self._middles) / self._ranges, speeds / self._top_speeds

    @abstractmethod
    def limit_speed(self, share: float) -> None:
        """Limits each joint to ``share`` of its usual speed, from the next target on."""

    @abstractmethod
    def command(self, keys: Keys) -> None:
        """Sets out to hold exactly ``keys`` down."""

    @abstractmethod
    def advance(self) -> None:
        """Sets the motors' targets for one emulator frame; call it before that frame's physics."""

    @abstractmethod
    def settle(self) -> None:
        """Puts everything at rest at once, and drops all commands."""


class Pressed(ABC):
    """A controller or joystick, whose keys the limbs press against springs.

    Args:
        body: number of the body in the physics client.
        springs: force or torque that brings each joint back, by the joint's number.
    """

    movables: list[tuple[int, float]]
    """As `Limbs.movables`."""
    press_depths: ClassVar[Sequence[float]]
    release_depths: ClassVar[Sequence[float]]
    """Hysteresis: each of `KEYS` is pressed beyond the first depth until it is back above the
    second."""

    def __init__(self, engine: Any, body: int, springs: Mapping[int, float]) -> None:
        self.body = body
        self._engine = engine
        self._states = engine.getJointStates
        self._joints = list(springs)
        for joint, force in springs.items():
            # A position motor with this little force acts as a spring.
            engine.setJointMotorControl2(
                body, joint, engine.POSITION_CONTROL, targetPosition=0.0, positionGain=0.5,
                velocityGain=0.5, force=force,
            )  # fmt: skip
        self._held = self._shown = Keys.NONE
        self.set_threshold(1.0)

    @abstractmethod
    def _depths(self) -> Sequence[float]:
        """Returns how far each of `KEYS` is pressed, once per frame."""

    @abstractmethod
    def _paint(self, key: Keys, *, pressed: bool) -> None:
        """Draws a key as pressed or released."""

    @property
    def held(self) -> Keys:
        """The keys that were held down at the last call of `pressed`."""
        return self._held

    def set_threshold(self, share: float) -> None:
        """Sets the depths at which a key is pressed and released to ``share`` of the usual ones."""
        self._closes = [share * depth for depth in self.press_depths]
        self._opens = [share * depth for depth in self.release_depths]

    def pressed(self) -> Keys:
        """Returns the keys held down now; call it once per frame."""
        before, held = int(self._held), 0
        for index, depth in enumerate(self._depths()):
            bit = 1 << index
            if depth > (self._opens if bit & before else self._closes)[index]:
                held |= bit
        self._held = _KEY_SETS[held]
        return self._held

    def show(self) -> None:
        """Colours pressed and released keys; call it before rendering them."""
        for key in KEYS:
            if key & (self._held ^ self._shown):
                self._paint(key, pressed=bool(key & self._held))
        self._shown = self._held

    def forget(self) -> None:
        """Treats every key as released, because the physics was restored to its start."""
        self._held = Keys.NONE
