"""Environments drawn for people, in a terminal of the test's own."""

import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
from collections.abc import Iterator
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest

import viewer.terminal.window
from ale_robot.environments import env_id
from common.errors import InputError
from tests.paths import ROOT
from viewer.terminal.terminal import write_all
from viewer.terminal.window import TerminalWindow

COLUMNS, ROWS = 60, 20
PICTURE = np.full((30, 40, 3), 200, np.uint8)


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    """Its far end, which reads what is shown, and its near end, for a program."""
    far, near = pty.openpty()
    fcntl.ioctl(near, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    yield far, near
    os.close(far)
    os.close(near)


@pytest.fixture
def out(terminal: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """The far end of a terminal that is this process's standard output."""
    far, near = terminal
    # Not sys.stdout itself, which is pytest's.
    with os.fdopen(os.dup(near), "w") as stdout:
        monkeypatch.setattr(viewer.terminal.window, "sys", SimpleNamespace(stdout=stdout))
        yield far


def received(far: int) -> bytes:
    """What has been written to the terminal since the last call."""
    sent = b""
    while select.select([far], [], [], 0.0)[0]:
        sent += os.read(far, 65_536)
    return sent


def shown(far: int) -> str:
    """As `received`, of a program that does not write just now."""
    return received(far).decode()


class Time:
    """Passes only while somebody sleeps."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        self.slept: list[float] = []
        monkeypatch.setattr("viewer.terminal.window.time.monotonic", lambda: self.now)
        monkeypatch.setattr("viewer.terminal.window.time.sleep", self._sleep)

    def _sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now += seconds


def test_pictures_come_at_a_steady_rate(out: int, monkeypatch: pytest.MonkeyPatch) -> None:
    time = Time(monkeypatch)
    window = TerminalWindow(10.0)
    for busy in (0.0, 0.03, 0.25, 0.0):
        time.now += busy
        window.show(PICTURE)
    window.close()
    # The one that is late is shown at once, and the next one not sooner for that.
    assert time.slept == pytest.approx([0.0, 0.07, 0.0, 0.1])


def test_an_infinite_rate_never_waits(out: int, monkeypatch: pytest.MonkeyPatch) -> None:
    time = Time(monkeypatch)
    window = TerminalWindow(float("inf"))
    for _ in range(3):
        window.show(PICTURE)
    window.close()
    assert time.slept == [0.0] * 3


def test_a_window_leaves_rows_for_what_is_printed_and_gives_them_all_back(out: int) -> None:
    window = TerminalWindow(float("inf"))
    window.show(PICTURE)
    text = shown(out)
    assert f"\x1b[{ROWS - 3};{ROWS}r" in text
    assert {int(row) for row in re.findall(r"\x1b\[(\d+);\d+H\x1b\[38", text)} == set(
        range(1, ROWS - 3)
    )
    assert text.endswith("\x1b8")  # the cursor is back where others print
    window.show(PICTURE)
    assert shown(out) == "\x1b7\x1b8"
    window.close()
    assert "\x1b[r" in shown(out)
    window.close()
    assert shown(out) == ""


def test_a_terminal_that_changes_its_size_is_drawn_anew(
    terminal: tuple[int, int], out: int
) -> None:
    window = TerminalWindow(float("inf"))
    window.show(PICTURE)
    shown(out)
    fcntl.ioctl(terminal[1], termios.TIOCSWINSZ, struct.pack("HHHH", 10, 30, 0, 0))
    window.show(PICTURE)
    text = shown(out)
    assert "\x1b[7;10r" in text
    assert "\x1b[2J" in text
    assert text.count("▀") == 30 * 6
    window.close()


@pytest.mark.parametrize("robot", [True, False], ids=["robot", "emulator"])
def test_without_a_terminal_only_pictures_are_offered(robot: bool) -> None:
    with pytest.raises(InputError, match='"human" draws into the terminal'):
        gymnasium.make(env_id("pong", robot=robot), render_mode="human")
    env = gymnasium.make(env_id("pong", robot=robot), render_mode="rgb_array")
    assert env.metadata["render_modes"] == ["rgb_array"]
    env.close()


PROGRAM = """
import sys
import gymnasium
from common.settings.clock import ClockConfig
env = gymnasium.make(sys.argv[1], render_mode="human", **eval(sys.argv[2]))
env.reset(seed=0)
for action in (2, 3, 4, 5, 1):
    _, _, _, _, info = env.step(action)
print("steps", info["game_steps"])
env.close()
print("closed")
"""


@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("ALERobot/Pong-v0", "{}"),
        ("ALERobot/Pong-v0", "{'clock': ClockConfig(sync=False)}"),
        ("ALERobot/Breakout-Emulator-v0", "{}"),
    ],
    ids=["robot", "robot-async", "emulator"],
)
def test_an_environment_for_people(terminal: tuple[int, int], name: str, how: str) -> None:
    far, near = terminal
    program = subprocess.Popen(
        [sys.executable, "-W", "error", "-c", PROGRAM, f"ale_robot:{name}", how],
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        stdout=near,
        stderr=subprocess.PIPE,
    )
    sent = b""
    # Read all along, or the terminal would fill up and hold the program up.
    while program.poll() is None:
        select.select([far], [], [], 0.05)
        sent += received(far)
    text = (sent + received(far)).decode()
    assert program.stderr is not None
    assert program.stderr.read() == b""
    program.stderr.close()
    assert program.returncode == 0
    assert text.count("\x1b7") == 6  # one picture after the reset and after each step
    assert text.count("▀") > COLUMNS * (ROWS - 4)
    assert "steps" in text
    assert text.index("\x1b[r") < text.index("closed")


def test_a_name_that_is_not_utf_8_is_written_escaped() -> None:
    read, write = os.pipe()
    write_all(write, "x\udcff plays")
    os.close(write)
    with os.fdopen(read) as written:
        assert written.read() == "x\\udcff plays"
