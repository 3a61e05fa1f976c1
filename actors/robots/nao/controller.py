"""The controller: five spring-loaded keys in a box on the desk.

Four direction keys are the quarters of a square that stands on its corner, so that a fingertip
on the edge between two neighbours holds both down: that is how one finger plays diagonals. Fire
is a round button for the other hand. A key is held while it is pushed far enough by something
real: there is no other way to press it.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.robots.nao.anatomy import Vector
from common.actions import Keys

TRAVEL = 0.004
"""m a key goes down before its stop."""
_GIVE = 0.0001
PRESS_DEPTH = 0.0020
RELEASE_DEPTH = 0.0012
"""m: a key counts as pressed beyond the first, until it comes back above the second."""
SPRING_FORCE = 0.6
"""N that push a key up."""

CENTRE: Vector = (0.205, 0.0, 0.0)
"""Of the box, on the desk's top."""
BOX: Vector = (0.085, 0.180, 0.016)
CAP_HEIGHT = 0.008
# A key at its stop is level with the box, so that a hard blow lands on the box: the engine lets a
# heavy arm push a light key a little beyond the limit of its joint, but not into what stands.
KEY_TOP = BOX[2] + TRAVEL
"""Height of a released key's top above the desk."""

_CROSS_Y = 0.052
_FIRE_Y = -0.052
KEY_PITCH = 0.014
"""Edge of a direction key, gap included."""
_GAP = 0.0006
_FIRE_RADIUS = 0.012
_KEY_MASS = 0.004
_FORESIGHT = 0.001
"""m before a key at which its contact with a fingertip counts: less than a resting one is above
it, whose contacts would cost as much as all else in a step."""

_HALF_DIAGONAL = KEY_PITCH / math.sqrt(2.0)
KEY_PLACES: dict[Keys, tuple[float, float]] = {
    Keys.UP: (_HALF_DIAGONAL, _CROSS_Y),
    Keys.DOWN: (-_HALF_DIAGONAL, _CROSS_Y),
    Keys.LEFT: (0.0, _CROSS_Y + _HALF_DIAGONAL),
    Keys.RIGHT: (0.0, _CROSS_Y - _HALF_DIAGONAL),
    Keys.FIRE: (0.0, _FIRE_Y),
}
"""Middle of each key in the box's frame (x away from the robot, y to its left)."""

_KEY_BITS = tuple(int(key) for key in KEY_PLACES)
_KEY_SETS = tuple(map(Keys, range(2 ** len(KEY_PLACES))))
"""Every set of keys by its bits: to make one costs more than to read the controller."""

CAP_RADIUS = math.hypot(_FIRE_RADIUS, CAP_HEIGHT / 2)
"""m around a key's middle, beyond which nothing of it is."""

_RELEASED = dict.fromkeys(KEY_PLACES, (0.20, 0.21, 0.24, 1.0))
_RELEASED[Keys.FIRE] = (0.62, 0.08, 0.08, 1.0)
_PRESSED = (0.20, 0.95, 0.35, 1.0)


def place_of(keys: Keys) -> tuple[float, float]:
    """Where, in the box's frame, one fingertip holds exactly ``keys`` down: the middle of a key,
    or of the edge that two neighbours share."""
    x, y = np.mean([KEY_PLACES[key] for key in KEY_PLACES if key & keys], axis=0)
    return (float(x), float(y))


CROSS_MIDDLE: tuple[float, float] = (0.0, _CROSS_Y)
"""Where the direction keys meet."""


class Controller:
    """The controller in a physics client; ``desk_top`` is the height it stands at."""

    def __init__(self, engine: Any, folder: Path, desk_top: float) -> None:
        path = folder / "controller.urdf"
        path.write_text(_urdf())
        self._engine = engine
        self._joint_states = engine.getJointStates
        self._key_top = desk_top + KEY_TOP
        self.body: int = engine.loadURDF(
            str(path), (CENTRE[0], CENTRE[1], desk_top + BOX[2] / 2), useFixedBase=True
        )
        names = [
            engine.getJointInfo(self.body, joint)[1].decode()
            for joint in range(engine.getNumJoints(self.body))
        ]
        self._joints = [names.index(str(key.name)) for key in KEY_PLACES]
        for joint in self._joints:
            # A motor that wants the key at the top with little force is a spring of that force.
            engine.setJointMotorControl2(
                self.body, joint, engine.POSITION_CONTROL, targetPosition=0.0,
                positionGain=0.5, velocityGain=0.5, force=SPRING_FORCE,
            )  # fmt: skip
            engine.changeDynamics(
                self.body, joint, restitution=0.0, jointDamping=0.0,
                contactProcessingThreshold=_FORESIGHT,
            )  # fmt: skip
        for link in (-1, *self._joints):
            # Smooth plastic: its little friction would cost more time than all else about keys.
            engine.changeDynamics(self.body, link, lateralFriction=0.0)
        self._held = Keys.NONE
        self._shown = Keys.NONE

    @property
    def held(self) -> Keys:
        """The keys that were held down when `pressed` was last asked."""
        return self._held

    @property
    def links(self) -> tuple[int, ...]:
        """Indices of the keys' links."""
        return tuple(self._joints)

    def depths(self) -> NDArray[np.float64]:
        """m that each key is down, in `KEY_PLACES`' order, ``float64 [5]``."""
        states = self._joint_states(self.body, self._joints)
        return np.array([state[0] for state in states])

    def pressed(self) -> Keys:
        """The keys held down now; call it once per emulator frame, for hysteresis and stops."""
        before, held = int(self._held), 0
        states = self._joint_states(self.body, self._joints)
        for bit, joint, state in zip(_KEY_BITS, self._joints, states, strict=True):
            if state[0] > (RELEASE_DEPTH if bit & before else PRESS_DEPTH):
                held |= bit
            if state[0] > TRAVEL + _GIVE:
                # The engine minds a joint's limit only once it is passed. A fingertip comes to
                # the box no later than to the stop, but it can knock a neighbour down from aside.
                self._engine.resetJointState(self.body, joint, TRAVEL, 0.0)
        self._held = _KEY_SETS[held]
        return self._held

    def show(self) -> None:
        """Colour the keys by whether they are pressed; needed only before a picture of them."""
        for key, joint in zip(KEY_PLACES, self._joints, strict=True):
            if key & (self._held ^ self._shown):
                colour = _PRESSED if key & self._held else _RELEASED[key]
                self._engine.changeVisualShape(self.body, joint, rgbaColor=colour)
        self._shown = self._held

    def forget(self) -> None:
        """Take every key for released, now that the physics has been put back to its start."""
        self._held = Keys.NONE

    def mimic(self, other: "Controller") -> None:
        """Have the keys where ``other`` has them, for a picture of it in another room."""
        for joint, depth in zip(self._joints, other.depths(), strict=True):
            self._engine.resetJointState(self.body, joint, depth)
        self._held = other.held

    def point(self, place: tuple[float, float], above: float) -> NDArray[np.float64]:
        """The point in the room ``above`` m over the released keys' tops at ``place``."""
        return np.array([CENTRE[0] + place[0], CENTRE[1] + place[1], self._key_top + above])


def _urdf() -> str:
    # Every shape lies in the middle of its link: only then does the engine see a contact coming,
    # and stops a fast fingertip at a surface instead of pushing it out again afterwards.
    width, depth, height = BOX
    box = f'<geometry><box size="{width} {depth} {height}"/>'
    parts = [
        '<link name="box"><inertial><mass value="0.4"/>'
        '<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>'
        f'<visual>{box}</geometry><material name="box"><color rgba="0.85 0.85 0.87 1"/>'
        f"</material></visual><collision>{box}</geometry></collision></link>"
    ]
    parts += [_key(key) for key in KEY_PLACES]
    return "\n".join(['<robot name="controller">', *parts, "</robot>", ""])


def _key(key: Keys) -> str:
    x, y = KEY_PLACES[key]
    edge = KEY_PITCH - _GAP
    # Fire looks round, but is touched as the square within it: the engine rounds cylinders off
    # by a margin of 1 mm, a quarter of the travel.
    box = f'<box size="{edge} {edge} {CAP_HEIGHT}"/>'
    disc = f'<cylinder radius="{_FIRE_RADIUS}" length="{CAP_HEIGHT}"/>'
    seen = f"<geometry>{disc if key is Keys.FIRE else box}</geometry>"
    touched = f"<geometry>{box}</geometry>"
    colour = " ".join(map(str, _RELEASED[key]))
    return (
        f'<link name="cap_{key.name}"><inertial><mass value="{_KEY_MASS}"/>'
        '<inertia ixx="2e-7" iyy="2e-7" izz="2e-7" ixy="0" ixz="0" iyz="0"/></inertial>'
        f'<visual>{seen}<material name="{key.name}"><color rgba="{colour}"/></material></visual>'
        f"<collision>{touched}</collision></link>"
        f'<joint name="{key.name}" type="prismatic"><parent link="box"/>'
        f'<child link="cap_{key.name}"/>'
        f'<origin xyz="{x} {y} {KEY_TOP - CAP_HEIGHT / 2 - BOX[2] / 2}" rpy="0 0 {math.pi / 4}"/>'
        '<axis xyz="0 0 -1"/>'
        f'<limit lower="0" upper="{TRAVEL}" velocity="10" effort="{SPRING_FORCE}"/></joint>'
    )
