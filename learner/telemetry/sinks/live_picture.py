"""An actor's live view, drawn into the terminal: each cell shows two pixels, one above the
other."""

from collections.abc import Iterator
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.color import Color
from rich.console import Console, ConsoleOptions, RenderResult
from rich.segment import Segment
from rich.style import Style

from common.actions import KEYS_OF_ACTION, Keys
from common.minus import points
from common.protocol.actor_stats import ActorStats
from common.protocol.live_view import LiveView
from common.q_bars import q_bars
from learner.telemetry import formats

_HALF = "▀"
_CELLS_ASPECT = 8 / 3
"""Width by height of a 4:3 picture, in cells that are twice as high as wide."""
_BEFORE_BARS = 26
"""Columns for an action's keys and its Q-value."""
_HEADING = 2
"""Lines above the Q-values."""
_CHOSEN = Style(color="yellow")
_BORDER, _GAME = (255, 214, 64), (255, 0, 255)
_MARGIN = 1.25
"""Size of the shown part of the camera picture, in sizes of the projected picture."""
_LEAST = 1 / 16
"""Minimum share of the camera picture that is shown, whatever corners an actor sends."""
_SHADES = 0xF8
"""Bits of a colour that are kept, so that neighbouring cells often share a style."""


class LivePicture:
    """A renderable of ``view``, the answer of the actor with ``stats``."""

    LEAST_WIDTH = 56

    def __init__(self, stats: ActorStats, view: LiveView) -> None:
        self._stats = stats
        self._view = view

    @staticmethod
    def height(width: int) -> int:
        """Returns the number of lines at ``width`` columns: a heading, the picture, the keys, and
        the actor's use of its machine. Q-values are shown below if there are more lines."""
        return 3 + round(width / _CELLS_ASPECT)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        view, dim = self._view, Style(dim=True)
        stats, width = self._stats, options.max_width
        title = f"{stats.name}: score {points(view.score)}, step {view.steps:,}"
        yield Segment(formats.one_line(title)[:width], Style(bold=True))
        yield Segment.line()
        pixels = _pixels(view, width, 2 * (self.height(width) - 3))
        for upper, under in zip(pixels[0::2], pixels[1::2], strict=True):
            cells = zip(upper.tolist(), under.tolist(), strict=True)
            row = (Segment(_HALF, _style(tuple(above), tuple(below))) for above, below in cells)
            yield from Segment.simplify(row)
            yield Segment.line()
        keys = f"commanded {_names(view.wanted)}, pressed {_names(view.pressed)}"
        if view.found:
            yield Segment(keys if view.actions else "", dim)  # ALE's actions alone have keys
        else:
            yield Segment("the screen is not found", Style(color="red", bold=True))
        yield Segment.line()
        taken = formats.taken(stats.busy_cores, stats.memory_bytes)
        yield Segment(f"{taken} on {formats.one_line(stats.machine)}"[:width], dim)
        yield Segment.line()
        spare = console.size.height - 1 - self.height(width) - _HEADING
        for text, style in self._q_values(spare, width):
            yield Segment(text, style)
            yield Segment.line()

    def _q_values(self, rows: int, width: int) -> Iterator[tuple[str, Style]]:
        """Yields a heading, and up to ``rows`` lines with the values of the best actions."""
        view = self._view
        if rows < 1 or not view.values:
            return
        yield "", Style()
        yield "Q-values", Style(dim=True)
        for index, told, bar in q_bars(np.array(view.values), rows, width - _BEFORE_BARS):
            keys = KEYS_OF_ACTION[view.actions[index]] if view.actions else None
            name = str(index) if keys is None else _names(keys)
            yield f"{name:<15} {told} {bar}", _CHOSEN if index == view.chosen else Style()


def _pixels(view: LiveView, width: int, height: int) -> NDArray[np.uint8]:
    """Returns the picture with the detected border and game, ``uint8 [height, width, 3]``.

    A damaged picture is black. `LiveView.check` has checked its size.
    """
    data = np.frombuffer(view.picture or view.frame, np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    if picture is None:
        return np.zeros((height, width, 3), np.uint8)
    corner, part = np.zeros(2), 1.0
    if view.border:  # only the part around the screen, which would have few cells otherwise
        border = np.reshape(view.border, (4, 2))
        part = float(np.clip(_MARGIN * np.ptp(border, axis=0).max(), _LEAST, 1.0))
        corner = (border.mean(axis=0) - part / 2).clip(0, 1 - part)
    size = np.array(picture.shape[1::-1])
    (left, top), (right, bottom) = (corner * size).astype(int), ((corner + part) * size).astype(int)
    seen = picture[top : max(bottom, top + 1), left : max(right, left + 1)]
    small = cv2.resize(seen, (width, height), interpolation=cv2.INTER_AREA)
    shown = np.ascontiguousarray(small[:, :, ::-1], np.uint8)
    for corners, colour in ((view.border, _BORDER), (view.game, _GAME)):
        if corners:
            places = (np.reshape(corners, (4, 2)) - corner) / part * (width, height) - 0.5
            cv2.polylines(shown, [places.round().astype(np.int32)], True, colour)
    return shown & np.uint8(_SHADES)


@lru_cache(maxsize=4_096)
def _style(above: tuple[int, int, int], below: tuple[int, int, int]) -> Style:
    return Style(color=Color.from_rgb(*above), bgcolor=Color.from_rgb(*below))


def _names(keys: int) -> str:
    names = [str(key.name).lower() for key in Keys if key & keys]
    return "+".join(names) or "none"
