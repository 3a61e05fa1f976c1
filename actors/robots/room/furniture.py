"""Static bodies of the room: floor, wall, desk, projector and projection screen."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.robots.room.rotation import Vector, about

Rgba = tuple[float, float, float, float]

_FLOOR: Rgba = (0.62, 0.52, 0.42, 1.0)
_WALL: Rgba = (0.84, 0.87, 0.90, 1.0)
_SCREEN: Rgba = (0.98, 0.98, 0.98, 1.0)
_WOOD: Rgba = (0.72, 0.56, 0.38, 1.0)
METAL: Rgba = (0.34, 0.36, 0.40, 1.0)
_GLASS: Rgba = (0.65, 0.85, 1.0, 1.0)

DESK_TOP = 0.204
"""Height of the desk, m, just over NAO's thighs."""
_DESK_THICKNESS = 0.010
_DESK_NEAR, _DESK_FAR, _DESK_WIDTH = 0.105, 0.400, 0.560

_SCREEN_X = 1.15
_PICTURE_CENTRE = (0.0, 0.545)
PICTURE_WIDTH, PICTURE_HEIGHT = 0.520, 0.390
"""Size of the projected picture with its border, m. It is the largest that stays wholly in view of
a camera that is turned by 10° in yaw and pitch and 15 % nearer."""
_SCREEN_MARGIN = 0.030
_SCREEN_THICKNESS = 0.006

_half_width, _half_height = PICTURE_WIDTH / 2, PICTURE_HEIGHT / 2
PICTURE_CORNERS: NDArray[np.float64] = np.array(
    [
        [_SCREEN_X, side * _half_width, _PICTURE_CENTRE[1] + rise * _half_height]
        for side, rise in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
)
"""Corners of the picture on the screen at its usual place, ``[4, 3]``: clockwise from the top left
from the robot's view."""


Box = tuple[Vector, Vector, Rgba]
"""Centre, edge lengths, colour."""


class Furniture:
    """The furniture in a physics client; ``more`` is what one kind of robot adds to it."""

    def __init__(self, engine: Any, more: Sequence[Box]) -> None:
        self._engine = engine
        # Every body costs time at every physics step, so static boxes share one.
        surroundings = _stand(engine, [*_ROOM, *more, *_PROJECTOR])
        desk = _stand(engine, _desk(), touchable=True)
        self._screen_stand = _stand(engine, _screen_stand())
        self.screen = _stand(engine, [_SCREEN_SHEET])
        """Body of the sheet that shows the picture."""
        self.names = {
            surroundings: "room/surroundings",
            desk: "room/desk",
            self._screen_stand: "room/screen_stand",
            self.screen: "room/screen",
        }
        """Names of the bodies."""
        self.screen_place = (0.0, 0.0)
        """Arguments of the last `place_screen`."""
        self.picture_corners = PICTURE_CORNERS
        """Corners of the projected picture, border included, at the screen's present place."""

    def place_screen(self, away: float, tilt: float) -> None:
        """Places the screen ``away`` m farther from the robot than usual, its upper edge tilted
        back by ``tilt`` degrees about the picture's middle."""
        self.screen_place = (away, tilt)
        turn = about((0.0, 1.0, 0.0), math.radians(tilt))
        middle = PICTURE_CORNERS.mean(axis=0)
        position = middle + np.array([away, 0.0, 0.0]) - turn @ middle
        attitude = self._engine.getQuaternionFromEuler((0.0, math.radians(tilt), 0.0))
        for body in (self._screen_stand, self.screen):
            self._engine.resetBasePositionAndOrientation(body, position.tolist(), attitude)
        self.picture_corners = PICTURE_CORNERS @ turn.T + position


_ROOM: list[Box] = [
    ((0.3, 1.5, -0.05), (5.0, 9.0, 0.1), _FLOOR),
    ((_SCREEN_X + 0.27, 1.5, 1.2), (0.04, 9.0, 2.5), _WALL),
]

_PROJECTOR: list[Box] = [
    # Over the robot and out of its view: decoration.
    ((0.10, 0.0, 1.02), (0.20, 0.17, 0.065), METAL),
    ((0.205, 0.035, 1.02), (0.014, 0.045, 0.045), _GLASS),
    ((0.10, 0.0, 1.20), (0.020, 0.020, 0.30), METAL),
]

_SHEET_WIDTH = PICTURE_WIDTH + 2 * _SCREEN_MARGIN
_SHEET_HEIGHT = PICTURE_HEIGHT + 2 * _SCREEN_MARGIN
_SCREEN_SHEET: Box = (
    (_SCREEN_X + _SCREEN_THICKNESS / 2, 0.0, _PICTURE_CENTRE[1]),
    (_SCREEN_THICKNESS, _SHEET_WIDTH, _SHEET_HEIGHT),
    _SCREEN,
)


def _desk() -> list[Box]:
    """Returns the desk's boxes, its top first."""
    middle, length = (_DESK_NEAR + _DESK_FAR) / 2, _DESK_FAR - _DESK_NEAR
    top: Box = (
        (middle, 0.0, DESK_TOP - _DESK_THICKNESS / 2),
        (length, _DESK_WIDTH, _DESK_THICKNESS),
        _WOOD,
    )
    leg = DESK_TOP - _DESK_THICKNESS
    legs: list[Box] = [
        ((x, y, leg / 2), (0.018, 0.018, leg), METAL)
        for x in (_DESK_NEAR + 0.02, _DESK_FAR - 0.02)
        for y in (-_DESK_WIDTH / 2 + 0.02, _DESK_WIDTH / 2 - 0.02)
    ]
    return [top, *legs]


def _screen_stand() -> list[Box]:
    """Returns the screen's case, the pole behind it and the feet."""
    back, z = _SCREEN_X + _SCREEN_THICKNESS, _PICTURE_CENTRE[1]
    return [
        (
            (back + 0.01, 0.0, z + _SHEET_HEIGHT / 2 + 0.02),
            (0.045, _SHEET_WIDTH + 0.06, 0.04),
            METAL,
        ),
        ((back + 0.03, 0.0, z / 2 + 0.2), (0.025, 0.025, z + 0.4), METAL),
        *(((back, y, 0.012), (0.30, 0.022, 0.024), METAL) for y in (-0.18, 0.18)),
        ((back + 0.03, 0.0, 0.012), (0.022, 0.36, 0.024), METAL),
    ]


def _stand(engine: Any, boxes: list[Box], *, touchable: bool = False) -> int:
    """Adds boxes as one static body; if ``touchable``, its first box can be touched."""
    halves = [[edge / 2 for edge in edges] for _, edges, _ in boxes]
    visual = engine.createVisualShapeArray(
        shapeTypes=[engine.GEOM_BOX] * len(boxes),
        halfExtents=halves,
        rgbaColors=[colour for _, _, colour in boxes],
        visualFramePositions=[middle for middle, _, _ in boxes],
    )
    touched = -1
    if touchable:
        touched = engine.createCollisionShape(
            engine.GEOM_BOX, halfExtents=halves[0], collisionFramePosition=boxes[0][0]
        )
    return int(
        engine.createMultiBody(
            baseMass=0.0, baseCollisionShapeIndex=touched, baseVisualShapeIndex=visual
        )
    )
