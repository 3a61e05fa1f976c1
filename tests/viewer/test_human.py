"""A person at a terminal of the test's own: plays, sees, leaves, and gets the terminal back."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import viewer.human
import viewer.terminal.terminal
from actors.envs.world import World
from common.actions import Keys
from common.dataset.reader import Dataset
from common.errors import InputError
from tests.paths import ROOT
from tests.viewer.person import Person
from viewer.human import Human, beside, keys_text, used_keys

GIVEN_BACK = b"\x1b[?1004l\x1b[0m\x1b[?25h\x1b[?1049l"
"""Shows the cursor and the first screen."""


@pytest.fixture
def person(forks: None) -> Iterator[Person]:
    person = Person("human")
    yield person
    person.close()


def test_a_person_presses_keys_through_the_hands(person: Person) -> None:
    person.sees("you ·····  keys .*latency")
    person.sees("▀")
    person.sees("keys ↑···●.*latency [0-9]+ ms \\(p99 [0-9]+\\)", typing=b"\x1b[A ")
    person.types(b"q")
    assert person.leaves() == 0
    assert person.has_the_terminal_back()


def test_ctrl_c_gives_the_terminal_back(person: Person) -> None:
    person.sees("latency")
    assert not person.has_the_terminal_back()
    person.types(b"\x03")
    assert person.leaves() == 0
    assert person.has_the_terminal_back()


@pytest.mark.usefixtures("forks")
def test_without_a_terminal_it_is_refused() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "viewer", "human"],
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == "error: pictures and keys need a terminal: run this command in one.\n"


def test_without_a_robot_it_is_refused() -> None:
    with pytest.raises(InputError, match="omit --env ale"):
        Human(env="ale").run(threading.Event())


class Seat:
    """A terminal for a game that runs in this process, and is over before anything is drawn."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, columns: int, rows: int) -> None:
        self.master, self.slave = pty.openpty()
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        self.before = termios.tcgetattr(self.slave)
        self._file = os.fdopen(self.slave, "r+b", buffering=0)
        # Not those of sys itself, which are pytest's.
        streams = SimpleNamespace(stdin=self._file, stdout=self._file)
        monkeypatch.setattr(viewer.terminal.terminal, "sys", streams)
        monkeypatch.setenv("TERM", "xterm-256color")

    def written(self) -> bytes:
        """Returns all that was written so far."""
        os.write(self.slave, b"\0")
        seen = b""
        # What was written comes in parts, and some time after.
        while not seen.endswith(b"\0"):
            seen += os.read(self.master, 1024)
        return seen[:-1]

    def close(self) -> None:
        """Look whether the terminal is as it was."""
        assert termios.tcgetattr(self.slave) == self.before
        self._file.close()
        os.close(self.master)


@pytest.fixture
def seat(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[int, int], Seat]]:
    seats = []

    def take(columns: int, rows: int) -> Seat:
        seats.append(Seat(monkeypatch, columns, rows))
        return seats[-1]

    yield take
    (taken,) = seats
    taken.close()


def test_a_terminal_that_is_too_small_is_refused(seat: Callable[[int, int], Seat]) -> None:
    taken = seat(30, 10)
    with pytest.raises(InputError, match="30 × 10 characters"):
        Human().run(threading.Event())
    assert taken.written() == b""


def test_a_stop_gives_the_terminal_back(seat: Callable[[int, int], Seat]) -> None:
    taken = seat(80, 24)
    stop = threading.Event()
    stop.set()
    Human().run(stop)
    assert taken.written().endswith(GIVEN_BACK)


def test_an_error_gives_the_terminal_back(
    seat: Callable[[int, int], Seat], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(world: World) -> None:
        raise RuntimeError("a fault of ours")

    taken = seat(80, 24)
    monkeypatch.setattr(World, "frame", fail)
    with pytest.raises(RuntimeError, match="a fault of ours"):
        Human().run(threading.Event())
    assert taken.written().endswith(GIVEN_BACK)


def test_keys_as_text() -> None:
    assert keys_text(Keys.NONE) == "·····"
    assert keys_text(Keys.UP | Keys.RIGHT | Keys.FIRE) == "↑··→●"


@pytest.mark.parametrize(
    ("game", "keys"),
    [
        ("pong", "← → space"),
        ("freeway", "↑ ↓"),
        ("seaquest", "↑ ↓ ← → space"),
    ],
)
def test_the_keys_that_a_game_uses(game: str, keys: str) -> None:
    assert used_keys(game) == keys


def test_the_hands_are_beside_the_game() -> None:
    game, hands = np.full((240, 320, 3), 9, np.uint8), np.full((120, 160, 3), 5, np.uint8)
    both = beside(game, hands)
    assert both.shape == (240, 480, 3)
    assert (both[:, :320] == game).all()
    assert (both[60:180, 320:] == hands).all()
    assert both[:60, 320:].max() == both[180:, 320:].max() == 0


@pytest.mark.usefixtures("forks")
def test_what_a_person_plays_is_recorded(tmp_path: Path) -> None:
    person = Person("human", "--record", str(tmp_path / "d"), "--play.minimal-actions")
    try:
        # Right and down are no action of Pong: down alone is not either, right is.
        person.sees("you ···→·", typing=b"\x1b[C")
        person.types(b"q")
        assert person.leaves() == 0
        assert re.search(rb"wrote 1 game of [0-9,]+ steps", person.seen)
    finally:
        person.close()
    dataset = Dataset(tmp_path / "d")
    (rows,) = dataset.read()
    assert 3 in rows["actions"] or 2 in rows["actions"]
    assert rows["truncated"][-1]
    assert dataset.config.action_count == 6
