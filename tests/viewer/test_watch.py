"""What `ale-robot watch` shows, at every size of terminal."""

import os
import re
import sys
import threading
from contextlib import AbstractContextManager
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import viewer.watch
from actors.envs.ale import AtariEnv
from actors.envs.robot import RobotEnv
from actors.envs.step_info import StepInfo
from actors.loop import play
from benchmarks.entry_point import add_entry_point
from common.errors import InputError
from common.network import build_network
from common.registry import ENVIRONMENTS, ROBOTS
from common.run.network_file import encode_network_file
from common.settings.conditions import PlayConfig
from common.settings.presets import PRESETS
from tests.extending.test_environment import CONFIG as LAMPS_CONFIG
from tests.extending.test_environment import LAMPS
from tests.extending.test_robot import FINGER
from tests.extending.test_robot import config as finger_config
from tests.extending.whole_run import added
from tests.paths import ROOT
from tests.viewer.commands import parsed
from tests.viewer.person import Person
from viewer.player import ShownPolicy, shown_env
from viewer.terminal.graphics import Graphics
from viewer.watch import LEAST_SIZE, Watch, WatchScreen

PLAY = PlayConfig(random_starts=0, minimal_actions=True)
VALUES = np.array([0.0, 0.5, 1.0, 0.25, 0.75, 0.1], np.float32)


class Step:
    """A step that chose the third action."""

    a_tm1 = 2
    s_t = np.full((4, 84, 84), 200, np.uint8)
    info = StepInfo(False, 7.0, 41)


def drawn(env: Any, size: tuple[int, int], values: Any = VALUES) -> tuple[str, WatchScreen]:
    config = replace(PRESETS["robot"], play=PLAY)
    screen = WatchScreen(env, config, "robot_pong")
    step: Any = Step()
    return screen.draw(size, step, values, [20.0, 21.0]), screen


def texts(written: str) -> dict[tuple[int, int], str]:
    """What was written as text, by row and column, without colours."""
    found = {}
    for row, column, text in re.findall(r"\x1b\[(\d+);(\d+)H([^▀]*?)\x1b\[K", written):
        found[int(row), int(column)] = re.sub(r"\x1b\[[0-9;]*m", "", text)
    return found


@pytest.fixture(scope="module")
def robot() -> Any:
    env = RobotEnv("pong", play=PLAY)
    env.reset(seed=1)
    env.step(2)
    yield env
    env.close()


@pytest.mark.parametrize("size", [LEAST_SIZE, (80, 24), (120, 40), (200, 50)])
def test_everything_is_there_and_within_the_terminal(robot: Any, size: tuple[int, int]) -> None:
    written, _ = drawn(robot, size)
    found = texts(written)
    assert all(row <= size[1] and column + len(text) <= size[0] + 1
               for (row, column), text in found.items())  # fmt: skip
    told = "\n".join(found.values())
    for words in ("score 7   step 41", "screen found", "commanded", "pressed", "Q-values"):
        assert words in told
    assert re.search(r"···→· +1\.000 █+$", told, re.MULTILINE)
    assert re.search(r"^····· +0\.000 ?$", told, re.MULTILINE) or size == LEAST_SIZE
    assert "q leaves; robot_pong plays pong (robot), 2 games over" in told
    # Yellow around the screen that was found, magenta around the game in it.
    assert re.search(r"38;2;2[0-9]{2};(1[0-9]|[0-9])?[0-9];2[0-9]{2}", written)


@pytest.mark.parametrize("size", [(1, 1), (1, 50), (2, 20), (300, 1), (60, 2), (5, 5)])
@pytest.mark.parametrize("graphics", [None, Graphics("kitty", (8, 16))])
def test_a_terminal_may_become_as_small_as_it_likes(
    robot: Any, size: tuple[int, int], graphics: Graphics | None
) -> None:
    config = replace(PRESETS["robot"], play=PLAY)
    step: Any = Step()
    for env in (robot, AtariEnv("pong", play=PLAY)):
        screen = WatchScreen(env, config, "robot_pong")
        screen.graphics = graphics
        assert texts(screen.draw(size, step, VALUES, []))


@pytest.mark.parametrize("size", [(80, 24), (120, 40), (200, 50), (300, 50), (170, 24)])
def test_the_picture_is_as_large_as_can_be_and_nothing_is_far_from_it(
    robot: Any, monkeypatch: pytest.MonkeyPatch, size: tuple[int, int]
) -> None:
    seen, hands = [], []
    of = WatchScreen._seen, WatchScreen._hands

    def see(its: WatchScreen, room: tuple[int, int]) -> NDArray[np.uint8]:
        seen.append(room)
        return of[0](its, room)

    def show_hands(its: WatchScreen, room: tuple[int, int], step: Any) -> NDArray[np.uint8]:
        hands.append(room)
        return of[1](its, room, step)

    monkeypatch.setattr(WatchScreen, "_seen", see)
    monkeypatch.setattr(WatchScreen, "_hands", show_hands)
    found = texts(drawn(robot, size)[0])
    (picture,) = seen
    columns = {column for row, column in found if row < size[1]}
    assert columns == {picture[0] + 2}  # with one between them
    assert hands[0][0] <= size[0] - picture[0] - 1
    # Either its height is all there is, or the texts are as narrow as they may be.
    assert size[1] * 2 - 2 - picture[1] <= 1 or size[0] - picture[0] - 1 <= 30


def test_a_larger_terminal_shows_a_larger_game(robot: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn_corners = []
    monkeypatch.setattr(
        "viewer.watch.overlay.outline",
        lambda picture, corners, scale, *_: drawn_corners.append(corners * scale),
    )
    heights = []
    for size in (LEAST_SIZE, (80, 24), (120, 40), (200, 50), (300, 80)):
        drawn(robot, size)
        border, _ = drawn_corners[-2:]  # the screen and, in it, the game
        heights.append(np.ptp(border[:, 1]))
        # Nearly all of what the terminal has room for.
        assert heights[-1] > 0.9 * min(2 * (size[1] - 1), (size[0] - 31) * 0.75) / 1.4
    assert heights == sorted(heights)


@pytest.mark.parametrize(
    ("size", "line"),
    [
        (LEAST_SIZE, "score 12340"),
        ((80, 24), "score 12340   step 41829"),
        ((119, 24), "score 12340   step 41829   games before 9870 11110 12120"),
        ((120, 20), "score 12340   step 41829   games before 10210 9870 11110 12120"),
    ],
)
def test_long_numbers_do_not_run_over_the_edge(
    robot: Any, size: tuple[int, int], line: str
) -> None:
    step: Any = Step()
    step.info = Step.info._replace(game_score=12340.0, game_steps=41829)
    scores = [12340.0, 10210.0, 9870.0, 11110.0, 12120.0]
    screen = WatchScreen(robot, replace(PRESETS["robot"], play=PLAY), "robot_pong")
    found = texts(screen.draw(size, step, VALUES, scores))
    assert line in found.values()
    assert all(column + len(text) <= size[0] + 1 for (_, column), text in found.items())


def test_numbers_below_zero_have_a_minus_sign(robot: Any) -> None:
    step: Any = Step()
    step.info = Step.info._replace(game_score=-7.0)
    screen = WatchScreen(robot, replace(PRESETS["robot"], play=PLAY), "robot_pong")
    found = "\n".join(texts(screen.draw((200, 50), step, VALUES - 1, [-21.0])).values())
    assert "score −7   step 41   games before −21" in found
    assert re.search(r"^····· +−1\.000 ?$", found, re.MULTILINE)
    assert "-" not in found.replace("Q-values", "")


def test_texts_are_on_the_black_of_the_pictures_ground(robot: Any) -> None:
    written, _ = drawn(robot, (80, 24))
    starts = re.findall(r"\x1b\[\d+;\d+H(?=[^▀]*?\x1b\[K)(\x1b\[[0-9;]*m)?", written)
    assert starts
    assert {start.endswith(";48;2;0;0;0m") for start in starts} == {True}


def test_what_does_not_change_is_not_written_again(robot: Any) -> None:
    first, screen = drawn(robot, (80, 24))
    step: Any = Step()
    assert len(screen.draw((80, 24), step, VALUES, [])) < len(first) / 5


def test_where_there_is_no_room_the_best_actions_are_shown(
    robot: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = np.arange(18, dtype=np.float32)
    config = replace(PRESETS["robot"], play=replace(PLAY, minimal_actions=False))
    monkeypatch.setattr(robot._game, "actions", tuple(range(18)))
    step: Any = Step()
    told = texts(WatchScreen(robot, config, "r").draw(LEAST_SIZE, step, values, [])).values()
    numbers = [float(text.split()[1]) for text in told if re.search(r"\d\.000", text)]
    assert numbers == sorted(values)[-len(numbers) :]
    assert 0 < len(numbers) < 18


def test_of_an_emulator_its_screen_and_the_input_are_shown() -> None:
    env = AtariEnv("pong", play=PLAY)
    env.reset(seed=1)
    written, _ = drawn(env, (80, 24), None)
    assert "screen found" not in written
    assert "random play" in written
    assert "↑ network's input" in written
    assert "38;2;200;200;200" in written


def pixels(written: str, size: tuple[int, int]) -> NDArray[np.uint8]:
    """The half blocks that were written into an empty terminal of ``size``."""
    columns, rows = size
    found = np.zeros((2 * rows, columns, 3), np.uint8)
    number = r"\d+"
    for row, column, cells in re.findall(
        rf"\x1b\[({number});({number})H((?:\x1b\[38[\d;]*m▀+)+)", written
    ):
        at = int(column) - 1
        for colours, blocks in re.findall(r"\x1b\[38;2;([\d;]+)m(▀+)", cells):
            upper, lower = colours.split(";48;2;")
            for line, colour in enumerate((upper, lower)):
                place = 2 * (int(row) - 1) + line, slice(at, at + len(blocks))
                found[place] = [int(each) for each in colour.split(";")]
            at += len(blocks)
    return found


def test_of_an_environment_from_outside_its_picture_the_input_and_numbers_are_shown() -> None:
    values = np.array([0.5, 1.0, 0.25], np.float32)
    config = LAMPS_CONFIG
    with added(ENVIRONMENTS, LAMPS), shown_env(config) as env:
        steps = play([env], ShownPolicy.of_file(config, None, 1.0, 1), [1])
        for step in islice(steps, 3):
            screen = WatchScreen(env, config, "my_lamps")
            size = (100, 30)
            written = screen.draw(size, step._replace(a_tm1=2), values, [3.0])
            picture = pixels(written, size)
            (lit,) = {lamp for lamp in range(3) if step.s_t[-1][42, 28 * lamp + 14]}
            for lamp in range(3):  # 69 columns of 52 pixels
                colour = (250, 220, 0) if lamp == lit else (0, 0, 200)
                assert picture[26, 11 + 23 * lamp].tolist() == list(colour)
            assert (picture[:7, :69] == picture[0, 0]).all()
            assert not (picture[26, :69] == picture[0, 0]).all(axis=1).any()
            # The network's input beside it, from column 70 to 99.
            assert [picture[4, 74 + 10 * lamp, 0] > 200 for lamp in range(3)].index(True) == lit
            told = "\n".join(texts(written).values())
            assert f"score {step.info.game_score:g}   step {step.info.game_steps}" in told
            for words in ("↑ network's input", "q leaves; my_lamps plays lamps, 1 game over"):
                assert words in told
            assert re.search(r"^    0   0\.500 █+\n    1   1\.000 █+\n    2   0\.250", told, re.M)


def test_of_a_robot_that_uses_no_camera_no_screen_is_found() -> None:
    config = finger_config()
    with added(ROBOTS, FINGER), shown_env(config) as env:
        env.reset(seed=1)
        step: Any = Step()
        written = WatchScreen(env, config, "f").draw((80, 24), step, VALUES, [])
    told = "\n".join(texts(written).values())
    assert "camera not used" in told
    assert "found" not in told
    assert "plays pong (finger)" in told


def test_without_a_terminal_it_is_refused_before_anything_is_built(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delattr(viewer.watch, "shown_env")
    with pytest.raises(InputError, match="need a terminal: run this command in one"):
        parsed(Watch, "--env", "ale").run(threading.Event())


def test_a_terminal_that_cannot_draw_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for stream in (sys.stdin, sys.stdout):
        monkeypatch.setattr(stream, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "dumb")
    with pytest.raises(InputError, match=r"^a terminal of TERM=dumb draws no pictures: use"):
        parsed(Watch, "--env", "ale").check()


def test_a_file_that_is_no_network_is_told_before_the_terminal_that_is_missing(
    tmp_path: Path,
) -> None:
    page = tmp_path / "README.md"
    page.write_text("# A page\n")
    with pytest.raises(InputError, match=r"README\.md holds no network .*: name a \.safetensors"):
        parsed(Watch, page).check()
    with pytest.raises(InputError, match="need a terminal"):
        parsed(Watch, "--env", "ale").check()


class Clock:
    """Time that passes only while somebody waits, or a step is drawn."""

    def __init__(self) -> None:
        self.now = 100.0
        self.waited: list[float] = []

    def monotonic(self) -> float:
        return self.now


class Paced(threading.Event):
    """Waits by a `Clock`."""

    def __init__(self, clock: Clock) -> None:
        super().__init__()
        self._clock = clock

    def wait(self, timeout: float | None = None) -> bool:
        assert timeout is not None
        self._clock.waited.append(timeout)
        self._clock.now += timeout
        return False


class NoTerminal(AbstractContextManager["NoTerminal"]):
    """A terminal that shows nothing."""

    size, cell = (80, 24), None

    def __init__(self, least: tuple[int, int]) -> None: ...

    def write(self, text: str) -> None: ...

    def keys(self) -> bytes:
        return b""

    def __exit__(self, *_: object) -> None: ...


def test_it_plays_as_fast_as_the_game_and_keeps_the_pace_after_a_late_picture(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = Clock()
    stop = Paced(clock)
    drawing = iter([0.01, 0.02, 0.5, 0.01, 0.01])  # seconds of each picture

    def draw(*_: object) -> str:
        clock.now += next(drawing)
        if len(clock.waited) == 4:
            stop.set()
        return ""

    monkeypatch.setattr("viewer.watch.time", clock)
    monkeypatch.setattr("viewer.watch.Terminal", NoTerminal)
    monkeypatch.setattr("viewer.watch.WatchScreen.draw", draw)
    parsed(Watch, "--env", "ale").run(stop)
    # Steps of 1/15 s, without the time of drawing; the third is late, and not made up for.
    period = 1 / 15
    assert clock.waited == pytest.approx(
        [period - 0.01, period - 0.02, 0.0, period - 0.01, period - 0.01]
    )


@pytest.mark.usefixtures("forks")
def test_a_person_watches_and_leaves() -> None:
    person = Person("watch", "--env", "ale")
    person.sees(r"ale_pong_sticky plays pong \(ale\)")
    person.types(b"q")
    assert person.leaves() == 0
    assert person.has_the_terminal_back()


@pytest.mark.usefixtures("forks")
def test_a_person_watches_an_environment_from_outside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_entry_point(tmp_path, "l", "environment", "lamps", "tests.extending.test_environment:LAMPS")
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}{os.pathsep}{tmp_path}")
    weights = tmp_path / "w.safetensors"
    weights.write_bytes(encode_network_file(build_network(LAMPS_CONFIG, 3), LAMPS_CONFIG))
    person = Person("watch", str(weights), columns=300)  # the last line has the whole path
    person.sees(r"plays lamps, 1 game over")
    person.types(b"q")
    assert person.leaves() == 0
    person.sees(r"game 1: score \d+")
    assert person.has_the_terminal_back()
