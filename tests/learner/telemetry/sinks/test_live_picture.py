"""What an actor sees, drawn into the terminal beside the figures, where there is room."""

import io
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from rich.cells import cell_len
from rich.console import Console

from common.protocol.actor_stats import ActorStats
from common.protocol.live_view import LiveView, ViewRequest
from learner.telemetry.live_feed import Asked
from learner.telemetry.sinks.display import LiveDisplay
from learner.telemetry.sinks.live_picture import LivePicture
from learner.telemetry.sinks.screen import Screen
from learner.telemetry.snapshot import ActorView
from tests.common.protocol.test_live_view import VIEW
from tests.learner.telemetry.snapshots import snapshot

STATS = ActorStats("a", "actor", 1, machine="host-7", busy_cores=0.98, memory_bytes=300_000_000)
RUN = snapshot({}, actors=(ActorView(stats=STATS, alive=True),))
_RED_LEFT_HALF = np.zeros((240, 320, 3), np.uint8)
_RED_LEFT_HALF[:, :160, 2] = 255
RED = cv2.imencode(".jpg", _RED_LEFT_HALF)[1].tobytes()
NOT_FOUND = replace(VIEW, picture=RED, border=(), game=())


def console(width: int, height: int) -> Console:
    return Console(
        file=io.StringIO(), width=width, height=height, force_terminal=True,
        color_system="truecolor",
    )  # fmt: skip


def drawn(view: LiveView, width: int = 160, height: int = 40) -> list[str]:
    screen = console(width, height)
    screen.print(Screen(RUN, LivePicture(STATS, view)), end="")
    told: str = screen.file.getvalue()  # type: ignore[attr-defined]
    return re.sub(r"\x1b\[[0-9;]*m", "", told).split("\n")


@pytest.mark.parametrize(
    ("width", "height", "picture"),
    [
        *((60, 60, (0, 0)), (140, 60, (0, 0)), (141, 24, (0, 0)), (300, 24, (0, 0))),
        *((141, 25, (56, 21)), (142, 60, (56, 21)), (184, 50, (56, 21)), (190, 50, (61, 23))),
        *((200, 50, (71, 27)), (200, 25, (57, 21)), (200, 28, (65, 24)), (300, 60, (73, 27))),
    ],
)
def test_it_is_beside_the_figures_where_there_is_room(
    width: int, height: int, picture: tuple[int, int]
) -> None:
    lines = drawn(VIEW, width, height)
    assert len(lines) <= height - 1
    assert all(cell_len(line.rstrip()) <= width for line in lines)
    cells = sum(line.count("▀") for line in lines)
    assert cells == picture[0] * picture[1]


def values_of(lines: list[str]) -> list[list[str]]:
    """The words of the lines below the heading of the Q-values."""
    (heading,) = (at for at, line in enumerate(lines) if line.rstrip().endswith("Q-values"))
    column = lines[heading].index("Q-values")
    return [words for line in lines[heading + 1 :] if (words := line[column:].split())]


def test_q_values_are_below_where_there_is_room() -> None:
    view = replace(VIEW, actions=(0, 1, 12), values=(-1.0, 1.0, 0.0), chosen=1)
    none, fire, left = values_of(drawn(view, 160, 60))
    assert (none, fire[:2]) == (["none", "−1.000"], ["fire", "1.000"])
    assert left[:2] == ["left+fire", "0.000"]
    assert set(fire[2]) == {"█"}
    assert len(fire[2]) == 2 * len(left[2]) == 30
    assert [words[0] for words in values_of(drawn(view, 160, 28))] == ["fire"]
    assert not any("Q-values" in line for line in drawn(view, 160, 27))
    unnamed = replace(view, actions=())
    assert [words[0] for words in values_of(drawn(unnamed, 160, 60))] == ["0", "1", "2"]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("x", [-10.0, 0.5, 1.0, 10.0])
def test_corners_that_are_no_screen_are_drawn_too(x: float) -> None:
    view = replace(VIEW, border=(x,) * 8, game=(-10.0, -10.0, 10.0, -10.0, 10.0, 10.0, -10.0, 10.0))
    assert any("▀" in line for line in drawn(view))


def test_it_tells_score_keys_and_what_the_actor_takes() -> None:
    text = "\n".join(drawn(VIEW))
    assert "a: score −3, step 70" in text
    assert "commanded fire, pressed up+down" in text
    assert "98 % CPU, 300 MB on host-7" in text
    assert "the screen is not found" in "\n".join(drawn(replace(VIEW, found=False)))
    without_keys = "\n".join(drawn(replace(VIEW, actions=())))
    assert "commanded" not in without_keys
    assert "98 % CPU, 300 MB on host-7" in without_keys


def colours(view: LiveView) -> list[list[tuple[int, ...]]]:
    """The upper colour of each cell, line by line."""
    screen = console(LivePicture.LEAST_WIDTH, 60)
    screen.print(LivePicture(STATS, view), end="")
    lines = screen.file.getvalue().split("\n")  # type: ignore[attr-defined]
    found = []
    for line in lines[1:22]:
        row: list[tuple[int, ...]] = []
        for colour, cells in re.findall(r"38;2;(\d+;\d+;\d+);48[\d;]*m(▀+)", line):
            row += [tuple(map(int, colour.split(";")))] * len(cells)
        found.append(row)
    return found


def test_its_cells_have_the_pictures_colours() -> None:
    for row in colours(NOT_FOUND):
        assert len(row) == LivePicture.LEAST_WIDTH
        assert all(red > 200 and green + blue < 100 for red, green, blue in row[:26])
        assert all(red < 60 for red, _, _ in row[30:])


def test_the_screen_that_was_found_fills_it_and_has_its_outline() -> None:
    # A tenth of the picture, at its right: nothing of the left half is seen.
    corners = (0.8, 0.4, 0.9, 0.4, 0.9, 0.5, 0.8, 0.5)
    rows = colours(replace(NOT_FOUND, border=corners))
    every = [colour for row in rows for colour in row]
    assert every.count((248, 208, 64)) > 40
    assert not any(red > 200 and green < 100 for red, green, _ in every)


def test_a_damaged_picture_is_black() -> None:
    rows = colours(replace(NOT_FOUND, picture=RED[:200]))
    assert {colour for row in rows for colour in row} == {(0, 0, 0)}


class Feed:
    def __init__(self) -> None:
        self.asked: list[Asked] = []

    def latest(self, asked: Asked) -> LiveView:
        self.asked.append(asked)
        return VIEW


@pytest.mark.parametrize(("width", "asked"), [(100, 0), (160, 1)])
def test_an_actor_is_asked_only_where_it_is_seen(width: int, asked: int) -> None:
    feed = Feed()
    display = LiveDisplay(console(width, 40))
    display.watch(feed)  # type: ignore[arg-type]
    display.write(snapshot({}))  # nobody is there yet
    display.write(RUN)
    assert feed.asked == [Asked("actor", "a", ViewRequest())] * asked
