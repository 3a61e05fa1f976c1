"""Primitive shapes that the bodies in the room are made of."""

from dataclasses import dataclass
from typing import Literal

from actors.robots.room.rotation import Vector

Colour = tuple[float, float, float]

QUARTER = 1.5707963
ALONG_X: Vector = (0.0, QUARTER, 0.0)
ALONG_Y: Vector = (QUARTER, 0.0, 0.0)
"""Turns of a rod."""


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


def ball(radius: float, origin: Vector, colour: Colour, *, solid: bool = False) -> Shape:
    return Shape("ball", (radius, 0.0, 0.0), origin, colour, solid=solid)


def rod(
    radius: float,
    length: float,
    origin: Vector,
    colour: Colour,
    turn: Vector = (0.0, 0.0, 0.0),
) -> Shape:
    return Shape("rod", (radius, length, 0.0), origin, colour, turn)
