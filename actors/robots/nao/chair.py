"""The chair that NAO sits on."""

from actors.robots.nao.posture import HIP_HEIGHT
from actors.robots.room.furniture import METAL, Box, Colour

_SEAT: Colour = (0.20, 0.38, 0.52, 1.0)

_HEIGHT = HIP_HEIGHT - 0.037
_LEG = _HEIGHT - 0.024

CHAIR: list[Box] = [
    ((-0.015, 0.0, _HEIGHT - 0.012), (0.170, 0.200, 0.024), _SEAT),
    ((-0.095, 0.0, _HEIGHT + 0.135), (0.018, 0.180, 0.130), _SEAT),
    *(((-0.095, y, _HEIGHT + 0.035), (0.012, 0.014, 0.090), METAL) for y in (-0.07, 0.07)),
    *(
        ((x, y, _LEG / 2), (0.014, 0.014, _LEG), METAL)
        for x in (-0.090, 0.060)
        for y in (-0.090, 0.090)
    ),
]
