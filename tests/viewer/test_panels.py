"""The four panels: everything is at its place, and says what it should."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from actors.vision.layout import GAME_IN_PICTURE
from common.actions import Keys
from viewer import overlay
from viewer.panels import PANEL, border_of, draw_panels
from viewer.snapshot import RobotSnapshot, Snapshot

WIDTH, HEIGHT = PANEL


def robot_snapshot() -> RobotSnapshot:
    return RobotSnapshot(
        outside=np.full((HEIGHT, WIDTH, 3), (200, 0, 0), np.uint8),
        camera=np.full((240, 320, 3), (0, 0, 200), np.uint8),
        corners=np.array([[100, 60], [220, 60], [220, 150], [100, 150]], np.float32),
        found=True,
        controller=np.full((HEIGHT, WIDTH, 3), (90, 90, 0), np.uint8),
    )


def snapshot(robot: RobotSnapshot | None, values: np.ndarray | None = None) -> Snapshot:
    frame = np.zeros((84, 84), np.uint8)
    frame[:42] = 255
    return Snapshot(
        game="pong",
        score=-3.0,
        step=12,
        screen=np.full((210, 160, 3), (0, 120, 0), np.uint8),
        frame=frame,
        wanted=Keys.NONE,
        pressed=Keys.NONE,
        actions=tuple(range(18)),
        chosen=4,
        values=values,
        robot=robot,
    )


def count(picture: np.ndarray, colour: overlay.Colour) -> int:
    """Pixels of nearly that colour: thin letters are nowhere wholly of theirs."""
    return int((np.abs(picture.astype(int) - colour) < 60).all(axis=2).sum())


def test_four_panels_for_a_robot() -> None:
    picture = draw_panels(snapshot(robot_snapshot()))
    assert picture.shape == (2 * HEIGHT, 2 * WIDTH, 3)
    middles = [picture[y, x].tolist() for y, x in ((100, 30), (100, 560), (650, 30))]
    assert middles == [[200, 0, 0], [0, 0, 200], [90, 90, 0]]
    # The network's input, half white and half black.
    assert picture[HEIGHT + 100, WIDTH + 100].tolist() == [255, 255, 255]
    assert picture[HEIGHT + 300, WIDTH + 100].tolist() == [0, 0, 0]


def test_two_panels_for_an_emulator() -> None:
    picture = draw_panels(snapshot(None))
    assert picture.shape == (HEIGHT, 2 * WIDTH, 3)
    assert picture[100, 100].tolist() == [0, 120, 0]


def test_what_was_found_is_drawn_where_it_is() -> None:
    camera = draw_panels(snapshot(robot_snapshot()))[:HEIGHT, WIDTH:]
    scale = WIDTH / 320
    # The border is 8 % of the game's own width and height.
    for colour, aside, above in ((overlay.MAGENTA, 0.0, 0.0), (overlay.YELLOW, 9.6, 7.2)):
        drawn = (np.abs(camera.astype(int) - colour) < 90).all(axis=2)
        # The four lines, where they cross the game's middle: each is a few pixels wide.
        rows = np.flatnonzero(drawn[:, round(160.5 * scale)])
        columns = np.flatnonzero(drawn[round(105.5 * scale)])
        found = [np.split(line, np.flatnonzero(np.diff(line) > 9) + 1) for line in (columns, rows)]
        middles = [float(np.mean(part)) for parts in found for part in parts]
        expected = [100.5 - aside, 220.5 + aside, 60.5 - above, 150.5 + above]
        np.testing.assert_allclose(middles, np.array(expected) * scale - 0.5, atol=0.6)


def test_a_screen_that_was_lost_is_told_in_red() -> None:
    found = draw_panels(snapshot(robot_snapshot()))
    lost = draw_panels(snapshot(replace(robot_snapshot(), found=False, corners=None)))
    assert count(found[:HEIGHT, WIDTH:], overlay.RED) == 0
    assert count(lost[:HEIGHT, WIDTH:], overlay.RED) > 0
    assert count(lost[:HEIGHT, WIDTH:], overlay.MAGENTA) == 0


def test_border_of_inverts_the_layout() -> None:
    outer = np.array([[40, 30], [300, 50], [290, 220], [30, 200]], np.float32)
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    homography = cv2.getPerspectiveTransform(unit, outer)
    game = cv2.perspectiveTransform(GAME_IN_PICTURE[None], homography)[0]
    np.testing.assert_allclose(border_of(np.asarray(game, np.float32)), outer, atol=0.01)


@pytest.mark.parametrize("key", [Keys.UP, Keys.DOWN, Keys.LEFT, Keys.RIGHT, Keys.FIRE])
def test_keys_are_filled_when_pressed_and_ringed_when_commanded(key: Keys) -> None:
    def drawn(wanted: Keys, pressed: Keys) -> np.ndarray:
        picture = np.zeros((100, 160, 3), np.uint8)
        overlay.controller_keys(picture, (80, 50), 62, wanted, pressed)
        return picture

    idle, pressed, wanted = (
        drawn(Keys.NONE, Keys.NONE),
        drawn(Keys.NONE, key),
        drawn(key, Keys.NONE),
    )
    assert count(idle, overlay.GREEN) == count(idle, overlay.YELLOW) == 0
    assert count(pressed, overlay.GREEN) > 100
    assert count(pressed, overlay.YELLOW) == count(wanted, overlay.GREEN) == 0
    assert count(wanted, overlay.YELLOW) > 20
    ys, xs = np.nonzero((pressed == overlay.GREEN).all(axis=2))
    right, down = xs.mean() - 49, ys.mean() - 50
    sides = {
        Keys.UP: down < -5 and abs(right) < 3,
        Keys.DOWN: down > 5 and abs(right) < 3,
        Keys.LEFT: right < -5 and abs(down) < 3,
        Keys.RIGHT: 5 < right < 20 and abs(down) < 3,
        Keys.FIRE: right > 40,
    }
    assert [side for side, there in sides.items() if there] == [key]


def test_bars_are_as_long_as_values_are_great() -> None:
    values = np.array([1.0, 3.0, 2.0, 5.0], np.float32)
    picture = np.zeros((120, 200, 3), np.uint8)
    overlay.action_values(picture, (0, 0, 200, 88), (0, 2, 3, 4), 3, values)
    bars = []
    for index in range(4):
        row = picture[index * 22 + 11 - 6]
        colour = overlay.YELLOW if index == 3 else overlay.GREY
        bars.append(int((row[32:158] == colour).all(axis=1).sum()))
    full = 200 - 34 - 44
    assert bars == [1, full // 2 + 1, full // 4 + 1 + (full % 4 > 2), full + 1]


def test_equal_values_have_no_bars() -> None:
    picture = np.zeros((120, 200, 3), np.uint8)
    overlay.action_values(picture, (0, 0, 200, 88), (0, 2), 0, np.zeros(2, np.float32))
    assert (picture[5, 34:158] == 0).all()
