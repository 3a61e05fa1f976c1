"""The four panels: everything is at its place, and says what it should."""

from collections.abc import Iterator
from contextlib import closing

import cv2
import numpy as np
import pytest

from actors.envs.ale import AtariEnv
from actors.envs.robot import RobotEnv
from actors.envs.step_info import StepInfo
from actors.loop import Step
from actors.vision.layout import GAME_IN_PICTURE, border_of
from actors.vision.screen_detector import Detection
from common.actions import Keys
from common.registry import ENVIRONMENTS
from tests.extending.test_environment import CONFIG as LAMPS_CONFIG
from tests.extending.test_environment import LAMPS
from tests.extending.whole_run import added
from viewer import overlay
from viewer import panels as panels_module
from viewer.panels import PANEL, Panels, camera_panel, hands_panel, network_panel
from viewer.player import shown_env

WIDTH, HEIGHT = PANEL
ALL = tuple(range(18))
CORNERS = np.array([[100, 60], [220, 60], [220, 150], [100, 150]], np.float32)


def camera(corners: np.ndarray | None, valid: bool) -> np.ndarray:
    seen = np.full((240, 320, 3), (0, 0, 200), np.uint8)
    return camera_panel(seen, Detection(np.zeros((84, 84), np.uint8), valid, corners))


def stepped(state: np.ndarray, action: int = 4) -> Step:
    info = StepInfo(game_over=False, game_score=-3.0, game_steps=12)
    return Step(0, False, state, True, action, False, 0.0, False, False, state, info)


def count(picture: np.ndarray, colour: overlay.Pixel) -> int:
    """Pixels of nearly that colour: thin letters are nowhere wholly of theirs."""
    return int((np.abs(picture.astype(int) - colour) < 60).all(axis=2).sum())


@pytest.fixture
def robot() -> Iterator[tuple[RobotEnv, Step]]:
    """One that pushes its stick up, and the step in which it began to."""
    with closing(RobotEnv("pong")) as env:
        env.reset(seed=3)
        state, *_, info = env.step(2)
        assert isinstance(state, np.ndarray)
        yield env, stepped(state, 2)._replace(info=StepInfo.of(info))


def test_four_panels_for_a_robot(robot: tuple[RobotEnv, Step]) -> None:
    env, step = robot
    with closing(Panels(env)) as panels:
        picture = panels.draw(step, None)
    assert picture.shape == (2 * HEIGHT, 2 * WIDTH, 3)
    screen = env.emulator.screen_rgb()
    expected = [
        env.robot.view(screen, WIDTH, HEIGHT, "room"),
        camera_panel(env.seen, env.detection),
        hands_panel(env.robot.view(screen, WIDTH, HEIGHT, "hands"), Keys.UP, env.pressed),
        network_panel("pong", step, tuple(range(18)), None),
    ]
    places = [(0, 0), (0, WIDTH), (HEIGHT, 0), (HEIGHT, WIDTH)]
    for panel, (top, left) in zip(expected, places, strict=True):
        # Without the lines between the panels and the captions below.
        inner = picture[top + 2 : top + HEIGHT - 24, left + 2 : left + WIDTH - 2]
        np.testing.assert_array_equal(inner, panel[2:-24, 2:-2])


def test_an_orbiting_view_of_the_room_turns_there_and_back(
    robot: tuple[RobotEnv, Step], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(panels_module, "_ORBIT_PICTURES", 4)
    env, step = robot
    with closing(Panels(env, orbiting=True)) as panels:
        rooms = [panels.draw(step, None)[2 : HEIGHT - 24, 2 : WIDTH - 2] for _ in range(5)]
    screen = env.emulator.screen_rgb()
    for room, turn in zip(rooms, (0, -13, -26, -13, 0), strict=True):
        expected = env.robot.view(screen, WIDTH, HEIGHT, "room", turn=turn)
        np.testing.assert_array_equal(room, expected[2:-24, 2:-2])
    assert np.abs(rooms[0].astype(int) - rooms[1]).mean() > 10


def test_the_room_is_rendered_now_and_then(
    robot: tuple[RobotEnv, Step], monkeypatch: pytest.MonkeyPatch
) -> None:
    env, step = robot
    moves: list[tuple[str, bool]] = []

    def view(
        screen: np.ndarray, width: int, height: int, place: str, *, moved: bool = True
    ) -> np.ndarray:
        moves.append((place, moved))
        return np.zeros((height, width, 3), np.uint8)

    monkeypatch.setattr(env.robot, "view", view)
    panels = Panels(env, room_every=2)
    for _ in range(3):
        panels.draw(step, None)
    assert [moved for place, moved in moves if place == "room"] == [True, False, True]
    assert [moved for place, moved in moves if place == "hands"] == [True] * 3


def test_two_panels_for_an_emulator() -> None:
    env = AtariEnv("pong")
    state, _ = env.reset(seed=3)
    assert isinstance(state, np.ndarray)
    step = stepped(state)
    picture = Panels(env).draw(step, None)
    assert picture.shape == (HEIGHT, 2 * WIDTH, 3)
    screen = cv2.resize(env.emulator.screen_rgb(), PANEL)
    np.testing.assert_array_equal(picture[: HEIGHT - 24, :WIDTH], screen[:-24])
    network = network_panel("pong", step, tuple(range(18)), None)
    np.testing.assert_array_equal(picture[:, WIDTH:], network)


def test_two_panels_for_an_environment_from_outside() -> None:
    with added(ENVIRONMENTS, LAMPS), shown_env(LAMPS_CONFIG) as env:
        state, _ = env.reset(seed=3)
        step = stepped(state, 2)
        picture = Panels(env).draw(step, None)
    assert picture.shape == (HEIGHT, 2 * WIDTH, 3)
    np.testing.assert_array_equal(picture[: HEIGHT - 24, :WIDTH], panel_of(env.seen)[:-24])
    network = network_panel("lamps", step, (None,) * 3, None)
    np.testing.assert_array_equal(picture[:, WIDTH:], network)


def panel_of(picture: np.ndarray) -> np.ndarray:
    return np.asarray(cv2.resize(picture, PANEL))


def test_an_action_that_is_not_of_ale_has_its_number() -> None:
    values = np.array([0.0, 1.0, 0.5], np.float32)
    step = stepped(np.zeros((4, 84, 84), np.uint8), 1)
    numbered, of_ale = (
        network_panel("lamps", step, actions, values) for actions in ((None,) * 3, (0, 3, 4))
    )
    # They stand where ALE's signs do, in three rows of 32 pixels; all else is the same.
    rows, columns = np.nonzero((numbered != of_ale).any(axis=2))
    assert 104 <= rows.min() < rows.max() < 200
    assert 356 <= columns.min() < columns.max() < 356 + 47
    for row, colour in ((0, overlay.GREY), (1, overlay.YELLOW)):
        assert count(numbered[104 + 32 * row :, 356:396][:32], colour) > 20


@pytest.mark.parametrize("chosen", [7, 90])
def test_of_many_actions_the_chosen_and_the_best_are_drawn(chosen: int) -> None:
    values = np.arange(100, dtype=np.float32)
    step = stepped(np.zeros((4, 84, 84), np.uint8), chosen)
    panel = network_panel("many", step, (None,) * 100, values)
    bars = panel[104:, 356 + 32]  # the first pixel of each
    yellow = (bars == overlay.YELLOW).all(axis=1)
    rows = np.flatnonzero(yellow | (bars == overlay.GREY).all(axis=1))
    drawn = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    # As many as ALE has actions: 7 and 83 to 99, or 82 to 99.
    assert len(drawn) == 18
    assert [bool(yellow[row].all()) for row in drawn].index(True) == {7: 0, 90: 8}[chosen]


def test_the_network_gets_what_is_shown_enlarged() -> None:
    state = np.zeros((4, 84, 84), np.uint8)
    state[-1, :42] = 255
    panel = network_panel("pong", stepped(state), tuple(range(18)), None)
    assert panel.shape == (HEIGHT, WIDTH, 3)
    assert panel[100, 100].tolist() == [255, 255, 255]
    assert panel[300, 100].tolist() == [0, 0, 0]
    # The chosen action is yellow, the fifth of 15 pixels each below the heading.
    yellow = np.flatnonzero((panel[:, 356:384] == overlay.YELLOW).all(axis=2).any(axis=1))
    assert 104 + 4 * 15 <= yellow.min() <= yellow.max() < 104 + 5 * 15


@pytest.mark.parametrize(("score", "told"), [(-3.0, "-3"), (1_234_567.0, "1234567")])
def test_a_score_is_written_in_full(
    monkeypatch: pytest.MonkeyPatch, score: float, told: str
) -> None:
    written: list[str] = []
    monkeypatch.setattr(overlay, "write", lambda _, text, *__, **___: written.append(text))
    step = stepped(np.zeros((4, 84, 84), np.uint8))
    step = step._replace(info=step.info._replace(game_score=score))
    network_panel("pong", step, ALL, None)
    assert f"score {told}" in written


def test_what_was_found_is_drawn_where_it_is() -> None:
    panel = camera(CORNERS, True)
    scale = WIDTH / 320
    # The border is 8 % of the game's own width and height.
    for colour, aside, above in ((overlay.MAGENTA, 0.0, 0.0), (overlay.YELLOW, 9.6, 7.2)):
        drawn = np.all(np.abs(panel.astype(int) - colour) < 90, axis=2)
        # The four lines, where they cross the game's middle: each is a few pixels wide.
        rows = np.flatnonzero(drawn[:, round(160.5 * scale)])
        columns = np.flatnonzero(drawn[round(105.5 * scale)])
        found = [np.split(line, np.flatnonzero(np.diff(line) > 9) + 1) for line in (columns, rows)]
        middles = [float(np.mean(part)) for parts in found for part in parts]
        expected = [100.5 - aside, 220.5 + aside, 60.5 - above, 150.5 + above]
        np.testing.assert_allclose(middles, np.array(expected) * scale - 0.5, atol=0.6)


def test_a_screen_that_was_lost_is_told_in_red() -> None:
    found, lost = camera(CORNERS, True), camera(None, False)
    assert count(found, overlay.RED) == 0
    assert count(lost, overlay.RED) > 0
    assert count(lost, overlay.MAGENTA) == 0
    unused = camera(None, True)
    assert count(unused, overlay.RED) == 0
    assert (unused[-24:] != found[-24:]).any()


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
        row = picture[index * 22 + 11 - 7]  # above the numbers
        colour = overlay.YELLOW if index == 3 else overlay.GREY
        bars.append(int((row[32:200] == colour).all(axis=1).sum()))
    full = bars[3] - 1
    assert full > 100
    assert bars == [1, round(full / 2) + 1, round(full / 4) + 1, full + 1]


@pytest.mark.parametrize(("actions", "high"), [(6, 7), (18, 4)])
def test_few_actions_have_large_numbers_and_all_have_whole_ones(actions: int, high: int) -> None:
    """Rows of numbers at half size, as a GIF has them, in pixels."""
    values = np.linspace(-12.34, -1.0, actions, dtype=np.float32)
    panel = network_panel("pong", stepped(np.zeros((4, 84, 84), np.uint8)), ALL[:actions], values)
    numbers = np.all(panel[104:, 440:] > 200, axis=2)
    assert not numbers[:, -2:].any()
    rows = np.flatnonzero(numbers.any(axis=1))
    first = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)[0]
    assert len(first) / 2 >= high


def test_equal_values_have_no_bars() -> None:
    picture = np.zeros((120, 200, 3), np.uint8)
    overlay.action_values(picture, (0, 0, 200, 88), (0, 2), 0, np.zeros(2, np.float32))
    assert (picture[5, 34:152] == 0).all()
