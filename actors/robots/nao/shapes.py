"""Appearance of the robot: primitive shapes for each link, in NAO's white, grey and orange.

The licence of the manufacturer's meshes forbids copying, so the parts are balls, rods, boxes and
eggs (balls stretched along the axes). The left side's shapes are mirrored for the right side.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

from actors.robots.nao.anatomy import TOP_CAMERA_ORIGIN, Vector
from actors.robots.nao.posture import FINGERTIP_IN_HAND, FINGERTIP_RADIUS

Colour = tuple[float, float, float]

WHITE: Colour = (0.95, 0.95, 0.96)
GREY: Colour = (0.42, 0.43, 0.46)
DARK: Colour = (0.10, 0.10, 0.12)
ORANGE: Colour = (0.98, 0.42, 0.06)
GLOW: Colour = (0.25, 0.70, 1.0)

_QUARTER = 1.5707963


@dataclass(frozen=True)
class Shape:
    """A primitive in its link's frame.

    ``size`` holds the three edges of a box, (radius, length, unused) of a rod along z, (radius,
    unused, unused) of a ball or the three half axes of an egg, in m.
    """

    kind: Literal["box", "rod", "ball", "egg"]
    size: Vector
    origin: Vector
    colour: Colour
    turn: Vector = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw, rad."""
    solid: bool = False
    """Whether the shape takes part in contacts."""

    @property
    def radius(self) -> float:
        """Radius around its origin that holds all of it, m."""
        if self.kind == "box":
            return math.hypot(*self.size) / 2
        if self.kind == "rod":
            return math.hypot(self.size[0], self.size[1] / 2)
        return max(self.size)


def _ball(radius: float, origin: Vector, colour: Colour, *, solid: bool = False) -> Shape:
    return Shape("ball", (radius, 0.0, 0.0), origin, colour, solid=solid)


def _rod(
    radius: float,
    length: float,
    origin: Vector,
    colour: Colour,
    turn: Vector = (0.0, 0.0, 0.0),
    *,
    solid: bool = False,
) -> Shape:
    return Shape("rod", (radius, length, 0.0), origin, colour, turn, solid)


_ALONG_X: Vector = (0.0, _QUARTER, 0.0)
_ALONG_Y: Vector = (_QUARTER, 0.0, 0.0)

_HEAD = (
    Shape("egg", (0.054, 0.063, 0.052), (-0.002, 0.0, 0.056), WHITE),
    Shape("egg", (0.040, 0.050, 0.028), (0.004, 0.0, 0.018), WHITE),
    # Loudspeakers in the ears, with their ring of lights.
    _rod(0.027, 0.134, (-0.004, 0.0, 0.056), GREY, _ALONG_Y),
    _rod(0.019, 0.138, (-0.004, 0.0, 0.056), ORANGE, _ALONG_Y),
    _rod(0.011, 0.141, (-0.004, 0.0, 0.056), DARK, _ALONG_Y),
    # Eyes: a dark socket, a bright ring, a pupil.
    *(
        part
        for side in (1, -1)
        for part in (
            _rod(0.0160, 0.012, (0.043, 0.0265 * side, 0.050), DARK, (0.0, _QUARTER, 0.42 * side)),
            _rod(0.0130, 0.014, (0.0435, 0.0268 * side, 0.050), GLOW, (0.0, _QUARTER, 0.42 * side)),
            _rod(0.0065, 0.016, (0.0440, 0.0270 * side, 0.050), DARK, (0.0, _QUARTER, 0.42 * side)),
        )
    ),
    # The two cameras, in the forehead and in the mouth.
    _rod(0.006, 0.008, (TOP_CAMERA_ORIGIN[0] - 0.010, 0.0, 0.068), DARK, _ALONG_X),
    _rod(0.006, 0.010, (0.0395, 0.0, 0.016), DARK, _ALONG_X),
    # The touch strip on top.
    Shape("egg", (0.030, 0.012, 0.010), (-0.006, 0.0, 0.102), GREY),
)

_TORSO = (
    Shape("egg", (0.052, 0.078, 0.062), (-0.002, 0.0, 0.066), WHITE),
    Shape("egg", (0.044, 0.060, 0.080), (0.000, 0.0, 0.012), WHITE),
    Shape("box", (0.062, 0.088, 0.040), (-0.004, 0.0, -0.072), GREY),
    # The chest's orange wedge with its button.
    Shape("box", (0.010, 0.016, 0.058), (0.0395, 0.022, 0.084), ORANGE, (0.50, -0.25, 0.0)),
    Shape("box", (0.010, 0.016, 0.058), (0.0395, -0.022, 0.084), ORANGE, (-0.50, -0.25, 0.0)),
    _rod(0.0125, 0.010, (0.048, 0.0, 0.052), GREY, _ALONG_X),
    _rod(0.0085, 0.014, (0.048, 0.0, 0.052), GLOW, _ALONG_X),
    # The axle of the shoulders.
    _rod(0.022, 0.150, (0.0, 0.0, 0.100), GREY, _ALONG_Y),
)

_NECK = (_rod(0.024, 0.050, (0.0, 0.0, -0.012), GREY),)

_LEFT: dict[str, tuple[Shape, ...]] = {
    "l_shoulder": (
        _ball(0.033, (0.0, 0.004, 0.0), WHITE),
        _rod(0.022, 0.010, (0.0, 0.034, 0.0), ORANGE, _ALONG_Y),
    ),
    "l_biceps": (
        _rod(0.022, 0.060, (0.052, 0.013, 0.0), GREY, _ALONG_X),
        Shape("egg", (0.040, 0.027, 0.029), (0.050, 0.015, 0.0), WHITE),
    ),
    "l_elbow": (_ball(0.0235, (0.0, 0.0, 0.0), GREY),),
    "l_forearm": (
        Shape("egg", (0.036, 0.027, 0.027), (0.034, 0.0, 0.0), WHITE),
        _rod(0.0225, 0.010, (0.056, 0.0, 0.0), ORANGE, _ALONG_X),
    ),
    "l_hand": (
        _rod(0.017, 0.020, (0.008, 0.0, 0.0), GREY, _ALONG_X),
        Shape("egg", (0.030, 0.024, 0.019), (0.040, 0.0, -0.004), WHITE),
        # Folded fingers and thumb, one pointing finger with its tip.
        _ball(0.009, (0.066, 0.014, -0.010), GREY),
        _ball(0.009, (0.066, -0.014, -0.010), GREY),
        _ball(0.008, (0.056, 0.013, -0.021), GREY),
        _ball(0.008, (0.056, -0.013, -0.021), GREY),
        _rod(0.0075, 0.036, (0.076, 0.0, -0.012), GREY, (0.0, _QUARTER + 0.35, 0.0)),
        _ball(0.0075, (0.092, 0.0, -0.018), GREY),
        _rod(0.0050, 0.024, (0.095, 0.0, -0.030), GREY, (0.0, -0.245, 0.0)),
        _ball(FINGERTIP_RADIUS, FINGERTIP_IN_HAND, ORANGE, solid=True),
    ),
    "l_pelvis": (_ball(0.036, (0.0, 0.0, 0.0), GREY),),
    "l_thigh": (
        _rod(0.030, 0.070, (0.0, 0.0, -0.048), GREY),
        Shape("egg", (0.037, 0.036, 0.052), (0.004, 0.003, -0.046), WHITE),
        _rod(0.020, 0.076, (0.002, 0.0, -0.100), ORANGE, _ALONG_Y),
    ),
    "l_shin": (
        _ball(0.033, (0.0, 0.0, 0.0), GREY),
        Shape("egg", (0.036, 0.035, 0.056), (0.006, 0.0, -0.050), WHITE),
        _rod(0.026, 0.040, (0.0, 0.0, -0.090), GREY),
    ),
    "l_foot": (
        Shape("egg", (0.078, 0.046, 0.040), (0.024, 0.004, -0.014), WHITE),
        Shape("box", (0.130, 0.078, 0.014), (0.024, 0.004, -0.0381), GREY),
    ),
}


def _mirrored(shape: Shape) -> Shape:
    x, y, z = shape.origin
    roll, pitch, yaw = shape.turn
    return replace(shape, origin=(x, -y, z), turn=(-roll, pitch, -yaw))


SHAPES: dict[str, tuple[Shape, ...]] = {
    "torso": _TORSO,
    "neck": _NECK,
    "head": _HEAD,
    **_LEFT,
    **{"r_" + name[2:]: tuple(map(_mirrored, shapes)) for name, shapes in _LEFT.items()},
}
"""Shapes of every link, by link name."""
