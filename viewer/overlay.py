"""Small drawings on pictures: captions, the controller's keys, actions as arrows, bars of values.

All functions draw into ``uint8 [height, width, 3]`` RGB in place; places are (x, y) in pixels.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from common.actions import KEYS_OF_ACTION, Keys

Pixel = tuple[int, int, int]

PAPER: Pixel = (24, 26, 30)
WHITE: Pixel = (236, 238, 240)
GREY: Pixel = (128, 132, 138)
GREEN: Pixel = (51, 242, 89)
"""The colour of pressed keys on the controller itself."""
YELLOW: Pixel = (255, 214, 64)
MAGENTA: Pixel = (255, 0, 255)
RED: Pixel = (240, 70, 60)

_FONT = cv2.FONT_HERSHEY_SIMPLEX
_SIZE = 0.6
"""OpenCV's scale of text, which can still be read at half the size in a GIF."""
_SMALL = 0.5
"""The scale of numbers in many rows."""
_PITCHES = (22, 32)
"""Least and greatest height of a row of numbers and signs, which grow with their room, pixels."""
_LEAST_ROW = 15
"""Height of a row in which ALE's 18 actions can still be read, pixels; of more actions, the best
are drawn."""
_KEY_AT: dict[Keys, tuple[int, int]] = {
    Keys.UP: (0, -1),
    Keys.DOWN: (0, 1),
    Keys.LEFT: (-1, 0),
    Keys.RIGHT: (1, 0),
}


def write(
    picture: NDArray[np.uint8],
    text: str,
    at: tuple[int, int],
    *,
    size: float = _SIZE,
    colour: Pixel = WHITE,
) -> None:
    """Writes ASCII text with the left end of its baseline ``at``."""
    cv2.putText(picture, text, at, _FONT, size, colour, 1, cv2.LINE_AA)


def caption(picture: NDArray[np.uint8], text: str, colour: Pixel = WHITE) -> None:
    """Writes ``text`` into the lower left corner, on a dark ground."""
    (width, _), _ = cv2.getTextSize(text, _FONT, _SIZE, 1)
    picture[-24:, : width + 14] = PAPER
    write(picture, text, (7, picture.shape[0] - 7), colour=colour)


def outline(
    picture: NDArray[np.uint8],
    corners: NDArray[np.float32],
    scale: float,
    colour: Pixel,
    thickness: int = 2,
) -> None:
    """Draws a quadrilateral, to a sixteenth of a pixel.

    Args:
        corners: ``float32 [4, 2]``, in pixels of the original, which ``picture`` shows ``scale``
            times as large.
    """
    # Pixel centres have whole coordinates.
    fine = np.round(((corners + 0.5) * scale - 0.5) * 16).astype(np.int32)
    cv2.polylines(picture, [fine], True, colour, thickness, cv2.LINE_AA, 4)


def controller_keys(
    picture: NDArray[np.uint8], centre: tuple[int, int], size: int, wanted: Keys, pressed: Keys
) -> None:
    """Draws the five keys from above, directions left and fire right: pressed keys are filled,
    commanded keys have a ring."""
    x, y = centre
    half = size // 5
    cross = x - size // 2
    quads: list[tuple[Keys, NDArray[np.int32]]] = []
    for key, (right, down) in _KEY_AT.items():
        middle = np.array([cross + round(right * half * 1.1), y + round(down * half * 1.1)])
        diamond = np.array([(0, -half), (half, 0), (0, half), (-half, 0)])
        quads.append((key, (middle + diamond).astype(np.int32)))
    for key, quad in quads:
        cv2.fillPoly(picture, [quad], GREEN if key & pressed else (58, 61, 68), cv2.LINE_AA)
    fire = (x + size // 2, y)
    fired = bool(Keys.FIRE & pressed)
    cv2.circle(picture, fire, half + 2, GREEN if fired else (110, 30, 30), -1, cv2.LINE_AA)
    # Rings last, so that no neighbour covers them.
    for key, quad in quads:
        if key & wanted:
            cv2.polylines(picture, [quad], True, YELLOW, 2, cv2.LINE_AA)
    if Keys.FIRE & wanted:
        cv2.circle(picture, fire, half + 2, YELLOW, 2, cv2.LINE_AA)


def action_sign(
    picture: NDArray[np.uint8],
    centre: tuple[int, int],
    action: int,
    colour: Pixel,
    scale: float,
) -> None:
    """Draws an action: an arrow, a red dot beside it for fire, or a dash for no key.

    It is 26 pixels wide and begins 7 pixels to the left of ``centre``, both times ``scale``.
    """
    keys = KEYS_OF_ACTION[action]
    x, y = centre
    thickness = 1 if scale < 1.3 else 2
    right = sum(_KEY_AT[key][0] for key in _KEY_AT if key & keys)
    down = sum(_KEY_AT[key][1] for key in _KEY_AT if key & keys)
    if right or down:
        reach = round((6 if right == 0 or down == 0 else 5) * scale)
        start, end = (x - reach * right, y - reach * down), (x + reach * right, y + reach * down)
        cv2.arrowedLine(picture, start, end, colour, thickness, cv2.LINE_AA, tipLength=0.4)
    if keys & Keys.FIRE:
        fire = (x + round(14 * scale), y)
        cv2.circle(picture, fire, round(3 * scale), RED, -1, cv2.LINE_AA)
    if not keys:
        reach = round(3 * scale)
        cv2.line(picture, (x - reach, y), (x + reach, y), colour, thickness, cv2.LINE_AA)


def action_values(
    picture: NDArray[np.uint8],
    area: tuple[int, int, int, int],
    actions: tuple[int | None, ...],
    chosen: int,
    values: NDArray[np.float32] | None,
) -> None:
    """Draws the actions, one below the other, with bars for their values if there are any.

    Bars range from the least value (no bar) to the greatest, because the differences matter; the
    numbers beside them are the values. Fewer actions are drawn larger. If there is no room for all,
    the chosen one and the best are drawn.

    Args:
        area: left, top, width, height.
        actions: ALE's numbers of the actions, whose keys are drawn; None for an action of which the
            index is written.
        chosen: index of the action to mark.
    """
    left, top, width, height = area
    least_pitch, most_pitch = _PITCHES
    ranks = np.zeros(len(actions)) if values is None else -values.astype(float)
    ranks[chosen] = -np.inf
    drawn = np.sort(np.argsort(ranks, kind="stable")[: height // _LEAST_ROW]).tolist()
    pitch = min(height // len(drawn), most_pitch)
    scale = max(pitch / least_pitch, 1.0)
    numbers = [] if values is None else [f"{values[index]:z.2f}" for index in drawn]
    *widths, usual = (
        cv2.getTextSize(number, _FONT, _SMALL * scale, 1)[0][0] for number in (*numbers, "-0.00")
    )
    sign = round(32 * scale)
    room = width - sign - max(*widths, usual) - 4 if widths else 0
    least = 0.0 if values is None else float(values.min())
    span = 0.0 if values is None else float(values.max()) - least
    for row, index in enumerate(drawn):
        colour = YELLOW if index == chosen else GREY
        middle = top + row * pitch + pitch // 2
        action = actions[index]
        if action is None:
            at = (left, middle + round(5 * scale))
            write(picture, str(index), at, size=_SMALL * scale, colour=colour)
        else:
            action_sign(picture, (left + round(8 * scale), middle), action, colour, scale)
        if values is None:
            continue
        length = round((float(values[index]) - least) / span * room) if span else 0
        above, below = middle - pitch // 3, middle + pitch // 3 + 1
        picture[above:below, left + sign : left + sign + 1 + length] = colour
        shade = YELLOW if index == chosen else WHITE
        at = (left + width - widths[row], middle + round(5 * scale))
        write(picture, numbers[row], at, size=_SMALL * scale, colour=shade)
