"""Appearance of the robot: primitive shapes for each link, in NAO's white, grey and orange.

The licence of the manufacturer's meshes forbids copying, so the parts are balls, rods, boxes and
eggs (balls stretched along the axes). The left side's shapes are mirrored for the right side.
"""

from dataclasses import replace

from actors.robots.nao.anatomy import TOP_CAMERA_ORIGIN
from actors.robots.nao.posture import FINGERTIP_IN_HAND, FINGERTIP_RADIUS
from actors.robots.room.shapes import ALONG_X, ALONG_Y, QUARTER, Colour, Shape, ball, rod

WHITE: Colour = (0.95, 0.95, 0.96)
GREY: Colour = (0.42, 0.43, 0.46)
DARK: Colour = (0.10, 0.10, 0.12)
ORANGE: Colour = (0.98, 0.42, 0.06)
GLOW: Colour = (0.25, 0.70, 1.0)

_HEAD = (
    Shape("egg", (0.054, 0.063, 0.052), (-0.002, 0.0, 0.056), WHITE),
    Shape("egg", (0.040, 0.050, 0.028), (0.004, 0.0, 0.018), WHITE),
    # Loudspeakers in the ears, with their ring of lights.
    rod(0.027, 0.134, (-0.004, 0.0, 0.056), GREY, ALONG_Y),
    rod(0.019, 0.138, (-0.004, 0.0, 0.056), ORANGE, ALONG_Y),
    rod(0.011, 0.141, (-0.004, 0.0, 0.056), DARK, ALONG_Y),
    # Eyes: a dark socket, a bright ring, a pupil.
    *(
        part
        for side in (1, -1)
        for part in (
            rod(0.0160, 0.012, (0.043, 0.0265 * side, 0.050), DARK, (0.0, QUARTER, 0.42 * side)),
            rod(0.0130, 0.014, (0.0435, 0.0268 * side, 0.050), GLOW, (0.0, QUARTER, 0.42 * side)),
            rod(0.0065, 0.016, (0.0440, 0.0270 * side, 0.050), DARK, (0.0, QUARTER, 0.42 * side)),
        )
    ),
    # The two cameras, in the forehead and in the mouth.
    rod(0.006, 0.008, (TOP_CAMERA_ORIGIN[0] - 0.010, 0.0, 0.068), DARK, ALONG_X),
    rod(0.006, 0.010, (0.0395, 0.0, 0.016), DARK, ALONG_X),
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
    rod(0.0125, 0.010, (0.048, 0.0, 0.052), GREY, ALONG_X),
    rod(0.0085, 0.014, (0.048, 0.0, 0.052), GLOW, ALONG_X),
    # The axle of the shoulders.
    rod(0.022, 0.150, (0.0, 0.0, 0.100), GREY, ALONG_Y),
)

_NECK = (rod(0.024, 0.050, (0.0, 0.0, -0.012), GREY),)

_LEFT: dict[str, tuple[Shape, ...]] = {
    "l_shoulder": (
        ball(0.033, (0.0, 0.004, 0.0), WHITE),
        rod(0.022, 0.010, (0.0, 0.034, 0.0), ORANGE, ALONG_Y),
    ),
    "l_biceps": (
        rod(0.022, 0.060, (0.052, 0.013, 0.0), GREY, ALONG_X),
        Shape("egg", (0.040, 0.027, 0.029), (0.050, 0.015, 0.0), WHITE),
    ),
    "l_elbow": (ball(0.0235, (0.0, 0.0, 0.0), GREY),),
    "l_forearm": (
        Shape("egg", (0.036, 0.027, 0.027), (0.034, 0.0, 0.0), WHITE),
        rod(0.0225, 0.010, (0.056, 0.0, 0.0), ORANGE, ALONG_X),
    ),
    "l_hand": (
        rod(0.017, 0.020, (0.008, 0.0, 0.0), GREY, ALONG_X),
        Shape("egg", (0.030, 0.024, 0.019), (0.040, 0.0, -0.004), WHITE),
        # Folded fingers and thumb, one pointing finger with its tip.
        ball(0.009, (0.066, 0.014, -0.010), GREY),
        ball(0.009, (0.066, -0.014, -0.010), GREY),
        ball(0.008, (0.056, 0.013, -0.021), GREY),
        ball(0.008, (0.056, -0.013, -0.021), GREY),
        rod(0.0075, 0.036, (0.076, 0.0, -0.012), GREY, (0.0, QUARTER + 0.35, 0.0)),
        ball(0.0075, (0.092, 0.0, -0.018), GREY),
        rod(0.0050, 0.024, (0.095, 0.0, -0.030), GREY, (0.0, -0.245, 0.0)),
        ball(FINGERTIP_RADIUS, FINGERTIP_IN_HAND, ORANGE, solid=True),
    ),
    "l_pelvis": (ball(0.036, (0.0, 0.0, 0.0), GREY),),
    "l_thigh": (
        rod(0.030, 0.070, (0.0, 0.0, -0.048), GREY),
        Shape("egg", (0.037, 0.036, 0.052), (0.004, 0.003, -0.046), WHITE),
        rod(0.020, 0.076, (0.002, 0.0, -0.100), ORANGE, ALONG_Y),
    ),
    "l_shin": (
        ball(0.033, (0.0, 0.0, 0.0), GREY),
        Shape("egg", (0.036, 0.035, 0.056), (0.006, 0.0, -0.050), WHITE),
        rod(0.026, 0.040, (0.0, 0.0, -0.090), GREY),
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
