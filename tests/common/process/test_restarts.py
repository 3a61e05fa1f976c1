"""A process that starts its work again, as a real process whose work is a few lines."""

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from common.exit_codes import EXIT_CODES
from tests.paths import ROOT
from tests.patience import PATIENCE, wait_until

HEAD = """
import os, signal, sys, threading
from pathlib import Path
from common.process import backoff, restarts
from common.errors import InputError, Unreachable
from common.process.program_end import exit_on_input_error
from common.process.lifeline import on_signals
backoff.FIRST_PAUSE = 0.01
for number in (signal.SIGINT, signal.SIGHUP):  # ignored where tests run in the background
    signal.signal(number, signal.SIG_DFL)
begun = Path(sys.argv[1])

def work(again):
    with begun.open("a") as file:
        file.write(f"{os.getpid()} {again}\\n")
    times = len(begun.read_text().splitlines())
"""
TAIL = """
exit_on_input_error(lambda: restarts.with_restarts("the work", work, int(sys.argv[2])))
"""
WAITS = """
    stop = threading.Event()
    on_signals(stop)
    print("waits", flush=True)
    begun.with_name("waits").touch()
    stop.wait()
    return 1
"""


class Work:
    """A process that does it; ``body`` is the rest of the function ``work(again)``."""

    def __init__(self, folder: Path, body: str, most: int) -> None:
        self._begun = folder / "begun"
        self._begun.touch()
        self.process = subprocess.Popen(
            [sys.executable, "-c", HEAD + body + TAIL, str(self._begun), str(most)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )

    def ended(self) -> tuple[int, list[str]]:
        """Status, and what it said of restarts."""
        _, errors = self.process.communicate(timeout=PATIENCE)
        said = [re.sub(r"after \d+ s", "after N s", line) for line in errors.splitlines()]
        return self.process.returncode, [line for line in said if line.startswith("the work")]

    def waits(self) -> None:
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "waits\n"

    @property
    def begun(self) -> list[tuple[int, bool]]:
        """Process and whether it was done again, for each time."""
        lines = map(str.split, self._begun.read_text().splitlines())
        return [(int(pid), again == "True") for pid, again in lines]


def test_work_that_is_killed_is_done_again_until_it_is_done(tmp_path: Path) -> None:
    body = "    if times < 3: os.kill(os.getpid(), signal.SIGKILL)\n    return 0\n"
    work = Work(tmp_path, body, 2)
    assert work.ended() == (
        0,
        [
            "the work ended by signal 9 after N s: restart 1 of 2 in 0 s.",
            "the work ended by signal 9 after N s: restart 2 of 2 in 0 s.",
        ],
    )
    assert [again for _, again in work.begun] == [False, True, True]
    assert len({work.process.pid, *(pid for pid, _ in work.begun)}) == 4


def test_work_is_done_again_where_nobody_can_read_that(tmp_path: Path) -> None:
    """As when a terminal has gone, or whatever wrote the log."""
    body = """
    if times == 1:
        while not begun.with_name("gone").exists(): pass
        os.kill(os.getpid(), signal.SIGKILL)
"""
    work = Work(tmp_path, body, 1)
    assert work.process.stderr is not None
    work.process.stderr.close()
    (tmp_path / "gone").touch()
    assert work.process.wait(PATIENCE) == 0
    assert [again for _, again in work.begun] == [False, True]


@pytest.mark.parametrize(
    ("end", "status"),
    [
        ("os.kill(os.getpid(), signal.SIGSEGV)", 128 + signal.SIGSEGV),
        ("raise ValueError('a mistake')", 1),
        ("raise InputError('x', 1)", 1),
        ("raise Unreachable('nobody is there')", 4),
    ],
)
def test_there_is_an_end_to_restarts(tmp_path: Path, end: str, status: int) -> None:
    work = Work(tmp_path, f"    {end}\n", 1)
    found, said = work.ended()
    assert found == status
    assert said[-1].endswith("after N s, and 1 restarts did not help.")
    assert len(work.begun) == 2


def test_a_full_disk_is_waited_for_without_a_limit(tmp_path: Path) -> None:
    body = """
    if times < 4: raise OSError(28, "No space left on device")
    if times == 4: os.kill(os.getpid(), signal.SIGKILL)
"""
    status, said = Work(tmp_path, body, 1).ended()
    assert status == 0
    assert said == [
        *["the work ended by status 75 after N s: another try in 0 s."] * 3,
        "the work ended by signal 9 after N s: restart 1 of 1 in 0 s.",
    ]


def test_what_was_long_ago_is_forgotten(tmp_path: Path) -> None:
    body = "    if times < 3: os.kill(os.getpid(), signal.SIGKILL)\n    return 0\n"
    status, said = Work(tmp_path, body + "restarts.SETTLED = -1.0\n", 1).ended()
    assert (status, len(said)) == (0, 2)


@pytest.mark.parametrize(
    "code",
    [*(code.number for code in EXIT_CODES if not code.again), 128 + signal.SIGTERM],
)
def test_what_is_in_vain_is_not_done_again(tmp_path: Path, code: int) -> None:
    work = Work(tmp_path, f"    return {code}\n", 5)
    assert work.ended() == (code, [])
    assert len(work.begun) == 1


def test_without_restarts_the_work_is_done_in_this_process(tmp_path: Path) -> None:
    work = Work(tmp_path, "    return 1\n", 0)
    assert work.ended() == (1, [])
    assert work.begun == [(work.process.pid, False)]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_who_asks_it_to_end_asks_the_work(tmp_path: Path, number: signal.Signals) -> None:
    work = Work(tmp_path, WAITS, 5)
    work.waits()
    work.process.send_signal(number)
    assert work.ended() == (1, [])
    assert len(work.begun) == 1


def test_a_signal_in_another_thread_is_handed_on_too(tmp_path: Path) -> None:
    """As one that comes just before the wait for the work: neither interrupts that wait. Libraries
    have threads before there is work, and the system may choose any."""
    ask = """
def ask():
    while not begun.with_name("waits").exists(): pass
    signal.pthread_kill(threading.get_ident(), signal.SIGTERM)
threading.Thread(target=ask).start()
"""
    work = Work(tmp_path, WAITS + ask, 5)
    work.waits()
    assert work.ended() == (1, [])
    assert len(work.begun) == 1


def test_a_child_that_was_stopped_is_started_again(tmp_path: Path) -> None:
    """Each change of its state is a signal, of which one may be left when it has ended."""
    body = """
    if times < 3:
        os.kill(os.getppid(), signal.SIGCHLD)
        os.kill(os.getpid(), signal.SIGKILL)
    return 0
"""
    assert Work(tmp_path, body, 2).ended()[0] == 0


def test_work_does_not_outlive_the_process_that_started_it(tmp_path: Path) -> None:
    body = WAITS.replace("    return 1", "    begun.write_text('left')")
    work = Work(tmp_path, body, 5)
    work.waits()
    work.process.kill()
    work.process.wait(PATIENCE)
    wait_until(lambda: (tmp_path / "begun").read_text() == "left", "the work has left")
