"""The controller: five spring-loaded keys in a box on the desk.

The four direction keys are the quarters of a square that stands on its corner: a fingertip on the
edge between two neighbours holds both down, so one finger can play diagonals. Fire is a round
button for the other hand. Only physical contact presses a key.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.robots.room.body import KEY_PRESSED, KEY_RELEASED, Pressed
from actors.robots.room.engine import joints_of
from actors.robots.room.rotation import Vector
from common.actions import Keys

TRAVEL = 0.004
"""Travel of a key from its top to its stop, m."""
_GIVE = 0.0001
PRESS_DEPTH = 0.0020
RELEASE_DEPTH = 0.0012
"""Hysteresis, m: a key is pressed beyond `PRESS_DEPTH` until it is back above `RELEASE_DEPTH`."""
SPRING_FORCE = 0.6
"""Force that pushes a key up, N."""

CENTRE: Vector = (0.205, 0.0, 0.0)
"""Centre of the box on top of the desk."""
BOX: Vector = (0.085, 0.180, 0.016)
CAP_HEIGHT = 0.008
# A key at its stop is level with the box, so that the box takes hard blows: the engine lets a heavy
# arm push a light key a little beyond its joint limit, but not into a static body.
KEY_TOP = BOX[2] + TRAVEL
"""Height of a released key's top above the desk."""

_CROSS_Y = 0.052
_FIRE_Y = -0.052
KEY_PITCH = 0.014
"""Edge length of a direction key, gap included."""
_GAP = 0.0006
_FIRE_RADIUS = 0.012
_KEY_MASS = 0.004
_CONTACT_DISTANCE = 0.001
"""Distance from a key, m, at which the engine starts to solve its contact with a fingertip. It is
less than `HOVER` in `arms`: contacts of resting fingertips would double the cost of a step."""

_HALF_DIAGONAL = KEY_PITCH / math.sqrt(2.0)
KEY_PLACES: dict[Keys, tuple[float, float]] = {
    Keys.UP: (_HALF_DIAGONAL, _CROSS_Y),
    Keys.DOWN: (-_HALF_DIAGONAL, _CROSS_Y),
    Keys.LEFT: (0.0, _CROSS_Y + _HALF_DIAGONAL),
    Keys.RIGHT: (0.0, _CROSS_Y - _HALF_DIAGONAL),
    Keys.FIRE: (0.0, _FIRE_Y),
}
"""Centre of each key in the box's frame (x away from the robot, y to its left), m."""

CAP_RADIUS = math.hypot(_FIRE_RADIUS, CAP_HEIGHT / 2)
"""Radius around a key's centre that holds all of it, m."""

_RELEASED = dict.fromkeys(KEY_PLACES, KEY_RELEASED)
_RELEASED[Keys.FIRE] = (0.62, 0.08, 0.08, 1.0)


def place_of(keys: Keys) -> tuple[float, float]:
    """Returns where, in the box's frame, one fingertip holds exactly ``keys`` down: the centre of a
    key, or of the edge that two neighbours share."""
    x, y = np.mean([KEY_PLACES[key] for key in KEY_PLACES if key & keys], axis=0)
    return (float(x), float(y))


CROSS_MIDDLE: tuple[float, float] = (0.0, _CROSS_Y)
"""Point where the direction keys meet."""


class Controller(Pressed):
    """The keys in a physics client; ``desk_top`` is the height of the desk, m."""

    press_depths = (PRESS_DEPTH,) * len(KEY_PLACES)
    release_depths = (RELEASE_DEPTH,) * len(KEY_PLACES)

    def __init__(self, engine: Any, folder: Path, desk_top: float) -> None:
        path = folder / "controller.urdf"
        path.write_text(_urdf())
        self._key_top = desk_top + KEY_TOP
        body: int = engine.loadURDF(
            str(path), (CENTRE[0], CENTRE[1], desk_top + BOX[2] / 2), useFixedBase=True
        )
        numbers = joints_of(engine, body)
        super().__init__(engine, body, {numbers[str(key.name)]: SPRING_FORCE for key in KEY_PLACES})
        self.movables = [(joint, CAP_RADIUS) for joint in self._joints]
        for joint in self._joints:
            engine.changeDynamics(
                self.body, joint, restitution=0.0, jointDamping=0.0,
                contactProcessingThreshold=_CONTACT_DISTANCE,
            )  # fmt: skip
        for link in (-1, *self._joints):
            # Friction on smooth plastic is small, and would cost more to compute than everything
            # else about the keys.
            engine.changeDynamics(self.body, link, lateralFriction=0.0)

    def depths(self) -> NDArray[np.float64]:
        """Returns how far each key is down, m, ``float64 [5]`` in `KEY_PLACES`' order."""
        states = self._states(self.body, self._joints)
        return np.array([state[0] for state in states])

    def _depths(self) -> list[float]:
        """Returns the `depths`, and enforces the keys' stops."""
        depths = [state[0] for state in self._states(self.body, self._joints)]
        for joint, depth in zip(self._joints, depths, strict=True):
            if depth > TRAVEL + _GIVE:
                # The engine enforces a joint limit only after it is passed. The box stops a
                # fingertip from above, but a fingertip can push a neighbour down from the side.
                self._engine.resetJointState(self.body, joint, TRAVEL, 0.0)
        return depths

    def _paint(self, key: Keys, *, pressed: bool) -> None:
        joint = self._joints[list(KEY_PLACES).index(key)]
        colour = KEY_PRESSED if pressed else _RELEASED[key]
        self._engine.changeVisualShape(self.body, joint, rgbaColor=colour)

    def mimic(self, other: "Controller") -> None:
        """Puts the keys where ``other`` has them, to render the same state in another room."""
        for joint, depth in zip(self._joints, other.depths(), strict=True):
            self._engine.resetJointState(self.body, joint, depth)
        self._held = other.held

    def point(self, place: tuple[float, float], above: float) -> NDArray[np.float64]:
        """Returns the point ``above`` m over the released keys' tops at ``place``, in the room."""
        return np.array([CENTRE[0] + place[0], CENTRE[1] + place[1], self._key_top + above])


def _urdf() -> str:
    # Every shape is centred in its link: only then does the engine predict contacts and stop a fast
    # fingertip at a surface, instead of pushing it out again afterwards.
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
    # Fire is drawn round, but its collision shape is the square within: the engine rounds cylinders
    # off by a margin of 1 mm, a quarter of the travel.
    box = f'<box size="{edge} {edge} {CAP_HEIGHT}"/>'
    disc = f'<cylinder radius="{_FIRE_RADIUS}" length="{CAP_HEIGHT}"/>'
    drawn = f"<geometry>{disc if key is Keys.FIRE else box}</geometry>"
    touched = f"<geometry>{box}</geometry>"
    colour = " ".join(map(str, _RELEASED[key]))
    return (
        f'<link name="cap_{key.name}"><inertial><mass value="{_KEY_MASS}"/>'
        '<inertia ixx="2e-7" iyy="2e-7" izz="2e-7" ixy="0" ixz="0" iyz="0"/></inertial>'
        f'<visual>{drawn}<material name="{key.name}"><color rgba="{colour}"/></material></visual>'
        f"<collision>{touched}</collision></link>"
        f'<joint name="{key.name}" type="prismatic"><parent link="box"/>'
        f'<child link="cap_{key.name}"/>'
        f'<origin xyz="{x} {y} {KEY_TOP - CAP_HEIGHT / 2 - BOX[2] / 2}" rpy="0 0 {math.pi / 4}"/>'
        '<axis xyz="0 0 -1"/>'
        f'<limit lower="0" upper="{TRAVEL}" velocity="10" effort="{SPRING_FORCE}"/></joint>'
    )
