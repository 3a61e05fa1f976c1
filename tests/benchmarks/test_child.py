"""Processes that a benchmark starts: helpers that answer, and modules that fail."""

import os
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from benchmarks.child import Helper, free_port, run_module
from benchmarks.hosted_run import HostedRun
from common.errors import InputError
from common.exit_codes import INTERRUPTED
from tests.paths import ROOT
from tests.patience import wait_until

SUMS = """
from benchmarks.child import serve

class Sums:
    def __init__(self, begin):
        self.sum = begin

    def add(self, number, numbers):
        self.sum += number + sum(numbers)
        return {"sum": self.sum}

serve(Sums)
"""


def test_a_free_port_is_kept_for_a_server() -> None:
    place = ("127.0.0.1", free_port())
    with socket.socket() as other, pytest.raises(OSError, match="already in use"):
        other.bind(place)
    with socket.create_server(place):
        pass


def test_a_helper_that_ends_is_told_by_its_name() -> None:
    def ask_on(helper: Helper) -> None:
        while True:
            helper.ask("play", 1.0, 1.0)

    with (
        Helper("the third", "benchmarks.many_actors_client", unknown=1) as helper,
        pytest.raises(InputError, match="the third failed"),
    ):
        ask_on(helper)


def test_a_helper_calls_the_methods_of_its_object(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sums.py").write_text(SUMS)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    with Helper("the sums", "sums", begin=5) as sums:
        assert sums.ask("add", 2, [1, 2]) == {"sum": 10}
        sums.begin("add", 1, [])
        assert sums.hear() == {"sum": 11}


def test_a_module_that_fails_is_told() -> None:
    with pytest.raises(InputError, match="ended with exit code 2"):
        run_module("json.tool", "--none")


WAITS = """
import pathlib, signal
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])
pathlib.Path("ready").touch()
signal.sigwait([signal.SIGTERM])
pathlib.Path("left").touch()
"""


def test_a_module_is_asked_to_end_before_an_interrupt_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "waits.py").write_text(WAITS)
    monkeypatch.chdir(tmp_path)
    waiting = threading.Event()
    wait = subprocess.Popen.wait

    def tell_and_wait(process: subprocess.Popen[bytes]) -> int:
        waiting.set()
        return wait(process)

    monkeypatch.setattr(subprocess.Popen, "wait", tell_and_wait)
    main = threading.main_thread().ident
    assert main is not None
    # Programs that other tests ran in this process may have left handlers of their own.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def interrupt() -> None:
        waiting.wait()  # an interrupt before would be one of the test itself
        wait_until((tmp_path / "ready").exists, "it works")
        signal.pthread_kill(main, signal.SIGINT)

    threading.Thread(target=interrupt).start()
    try:
        with pytest.raises(KeyboardInterrupt):
            run_module("waits")
    finally:
        signal.signal(signal.SIGINT, before)
    assert (tmp_path / "left").exists()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_program_that_ends_asks_what_it_started(number: signal.Signals, tmp_path: Path) -> None:
    (tmp_path / "waits.py").write_text(WAITS)
    program = "from benchmarks.child import *; run_program(lambda: run_module('waits'))"
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{tmp_path}"}
    command = [sys.executable, "-c", program]
    with subprocess.Popen(command, cwd=tmp_path, env=environment) as process:
        wait_until((tmp_path / "ready").exists, "it works")
        process.send_signal(number)
    assert process.returncode == (INTERRUPTED if number == signal.SIGTERM else -number)
    wait_until((tmp_path / "left").exists, "what it started was asked to end")


SLOW = """
import pathlib, threading, time
from common.process import lifeline
lifeline._TOGETHER = -1.0  # no two signals are one
stop = threading.Event()
lifeline.on_signals(stop)
pathlib.Path("ready").touch()
stop.wait()
pathlib.Path("asked").touch()
while not pathlib.Path("go").exists():
    time.sleep(0.01)
pathlib.Path("left").touch()
"""


def test_a_program_that_is_killed_while_it_waits_leaves_what_it_started_its_time(
    tmp_path: Path,
) -> None:
    """`timeout -k` and schedulers do so; Linux then sends a second SIGTERM."""
    (tmp_path / "waits.py").write_text(SLOW)
    program = "from benchmarks.child import *; run_program(lambda: run_module('waits'))"
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{tmp_path}"}
    command = [sys.executable, "-c", program]
    with subprocess.Popen(command, cwd=tmp_path, env=environment) as process:
        wait_until((tmp_path / "ready").exists, "it works")
        process.terminate()
        wait_until((tmp_path / "asked").exists, "it was asked to end")
        process.kill()
    (tmp_path / "go").touch()
    wait_until((tmp_path / "left").exists, "it has ended in its own time")


def test_a_run_that_cannot_be_hosted_says_why() -> None:
    with (
        pytest.raises(InputError, match=r"the replay ended, and said: .*capacity"),
        HostedRun("replay", "--replay.capacity", "1"),
    ):
        pass
