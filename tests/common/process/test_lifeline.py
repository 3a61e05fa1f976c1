"""How processes learn that they should end: real ones, with a real parent and real signals."""

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import pytest

from common.process import lifeline
from tests.paths import ROOT
from tests.patience import PATIENCE

LEASHED = f"""
import threading
from common.process import lifeline

lifeline.GRACE = {PATIENCE}
stop = threading.Event()
lifeline.on_signals(stop)
lifeline.leave_with_parent()
print("ready", flush=True)
stop.wait()
"""
ON_A_LEASH = f"""{LEASHED}
print("left", flush=True)
"""
LEAVING = f"""{LEASHED}
lifeline._TOGETHER = 0.0
print("stopping", flush=True)
leash = next(each for each in threading.enumerate() if each.name == "leash")
leash.join(0.5)  # until it has seen the end of standard input, and more
print("left", flush=True)
"""

DEAF = """
import signal, threading
from common.process import lifeline

signal.signal(signal.SIGTERM, signal.SIG_IGN)
lifeline.GRACE = 0.1
lifeline.leave_with_parent()
print("ready", flush=True)
threading.Event().wait()
"""

ON_SIGNALS = """
import signal, sys, threading
from common.process import lifeline

signal.signal(signal.SIGHUP, signal.{hangup})  # these tests may themselves run under nohup
lifeline._TOGETHER = {together}
stop = threading.Event()
lifeline.on_signals(stop)
print("ready", flush=True)
stop.wait()
print("stopping", flush=True)
sys.stdin.read()
"""


def on_signals(together: float, hangup: str = "SIG_DFL") -> str:
    return ON_SIGNALS.format(together=together, hangup=hangup)


def line(process: "subprocess.Popen[str]") -> str:
    """The next one; none of a process that says nothing for too long, which is then killed."""
    assert process.stdout is not None
    end = threading.Timer(PATIENCE, process.kill)
    end.start()
    try:
        return process.stdout.readline()
    finally:
        end.cancel()


def start(script: str, stderr: int | None = None) -> "subprocess.Popen[str]":
    process = subprocess.Popen(
        [sys.executable, "-c", script],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=stderr,
        text=True,
    )
    assert line(process) == "ready\n"
    return process


def test_a_process_leaves_when_its_standard_input_ends() -> None:
    process = start(ON_A_LEASH)
    assert process.poll() is None
    output, _ = process.communicate(timeout=PATIENCE)
    assert output == "left\n"
    assert process.returncode == 0


def test_what_arrives_at_standard_input_does_not_end_it() -> None:
    process = start(ON_A_LEASH)
    assert process.stdin is not None
    process.stdin.write("text\n" * 1_000)
    process.stdin.flush()
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.2)
    output, _ = process.communicate(timeout=PATIENCE)
    assert output == "left\n"


def test_a_process_that_is_leaving_is_not_hurried_by_its_leash() -> None:
    process = start(LEAVING)
    process.send_signal(signal.SIGTERM)
    assert line(process) == "stopping\n"
    output, _ = process.communicate(timeout=PATIENCE)
    assert output == "left\n"
    assert process.returncode == 0


def test_a_process_that_does_not_leave_is_ended() -> None:
    process = start(DEAF)
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 1


def test_a_process_leaves_with_a_parent_that_was_killed() -> None:
    grandchild = (
        "import subprocess, sys\n"
        f"child = subprocess.Popen([sys.executable, '-c', {ON_A_LEASH!r}], stdin=subprocess.PIPE)\n"
        "child.wait()\n"
    )
    parent = start(grandchild)  # the grandchild says that it is ready, to the same pipe
    parent.kill()
    assert parent.stdout is not None
    assert parent.stdout.read() == "left\n"  # ends when the grandchild's end of it is closed
    parent.communicate(timeout=PATIENCE)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_first_signal_asks_it_to_stop(number: signal.Signals) -> None:
    process = start(on_signals(together=0.0))
    process.send_signal(number)
    output, _ = process.communicate(timeout=PATIENCE)
    assert output == "stopping\n"
    assert process.returncode == 0


def test_a_signal_may_come_while_the_event_is_locked() -> None:
    """As it is for a moment at the start of each wait, in the thread that handles signals."""
    process = start(
        "import signal, threading\n"
        "from common.process import lifeline\n"
        "stop = threading.Event()\n"
        "lifeline.on_signals(stop)\n"
        "print('ready', flush=True)\n"
        "with stop._cond:\n"
        "    signal.raise_signal(signal.SIGTERM)\n"
        "stop.wait()\n"
        "print('stopping', flush=True)\n"
    )
    assert line(process) == "stopping\n"
    process.communicate(timeout=PATIENCE)


def test_a_signal_may_come_in_another_thread() -> None:
    """It interrupts no wait of the main thread then, nor does one that comes just before a wait."""
    process = start(
        "import signal, threading\n"
        "from common.process import lifeline\n"
        "stop = threading.Event()\n"
        "lifeline.on_signals(stop)\n"
        "def send():\n"
        "    while not stop._cond._waiters:\n"
        "        pass\n"
        "    signal.pthread_kill(threading.get_ident(), signal.SIGTERM)\n"
        "threading.Thread(target=send).start()\n"
        "print('ready', flush=True)\n"
        "stop.wait()\n"
        "print('stopping', flush=True)\n"
    )
    assert line(process) == "stopping\n"
    process.communicate(timeout=PATIENCE)


def test_a_signal_that_a_library_heeds_stops_nothing() -> None:
    process = start(
        "import signal, threading\n"
        "from common.process import lifeline\n"
        "stop = threading.Event()\n"
        "lifeline.on_signals(stop)\n"
        "signal.signal(signal.SIGUSR1, lambda number, frame: None)\n"
        "signal.raise_signal(signal.SIGUSR1)\n"
        "print('ready', flush=True)\n"
        "print('stopped' if stop.wait(0.3) else 'works', flush=True)\n"
    )
    assert line(process) == "works\n"
    process.communicate(timeout=PATIENCE)


def stopping(together: float, stderr: int | None = None) -> "subprocess.Popen[str]":
    """A process that got a signal, and is about to stop once its standard input ends."""
    process = start(on_signals(together=together), stderr)
    process.send_signal(signal.SIGTERM)
    assert line(process) == "stopping\n"
    return process


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_later_signal_ends_it_at_once(number: signal.Signals, status: int) -> None:
    process = stopping(together=0.0, stderr=subprocess.PIPE)
    process.send_signal(number)
    assert process.wait(PATIENCE) == status
    told = "ended at once, by a second signal: what was not saved is lost\n"
    assert process.communicate() == ("", told)


def test_a_terminal_whose_screen_is_ended_at_once_has_its_cursor_again() -> None:
    ours, its = os.openpty()
    process = stopping(together=0.0, stderr=its)
    os.close(its)
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE) == 130
    assert b"\x1b[?25hended at once" in os.read(ours, 1_000)
    os.close(ours)
    process.communicate()


@pytest.mark.parametrize("full", [True, False])
def test_a_later_signal_ends_it_though_nobody_reads_what_it_says(full: bool) -> None:
    reader, writer = os.pipe()
    if full:
        os.set_blocking(writer, False)
        with suppress(BlockingIOError):
            while os.write(writer, bytes(4_096)):
                pass
        os.set_blocking(writer, True)
    else:
        os.close(reader)
    process = stopping(together=0.0, stderr=writer)
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE) == 130
    for end in (writer, *([reader] if full else [])):
        os.close(end)
    process.communicate()


def test_a_terminal_that_closes_hurries_nobody() -> None:
    process = stopping(together=0.0)
    process.send_signal(signal.SIGHUP)
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 0


def test_under_nohup_a_terminal_that_closes_is_nothing() -> None:
    process = start(on_signals(together=0.0, hangup="SIG_IGN"))
    process.send_signal(signal.SIGHUP)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.2)
    process.send_signal(signal.SIGTERM)
    output, _ = process.communicate(timeout=PATIENCE)
    assert output == "stopping\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_that_come_together_are_one(number: signal.Signals) -> None:
    process = stopping(together=1e9)
    process.send_signal(number)
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 0


SLOW_IMPORT = """
import signal

print("importing", flush=True)
signal.pause()
"""


def importing(folder: Path, *arguments: str, within: Sequence[str] = ()) -> "subprocess.Popen[str]":
    """A program that is still at its imports."""
    (folder / "numpy.py").write_text(SLOW_IMPORT)
    process = subprocess.Popen(
        [*within, sys.executable, "-m", *arguments],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(folder)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell's background job, which these tests may be, ignores Ctrl-C.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert line(process) == "importing\n"
    return process


@pytest.mark.parametrize("program", ["actors", "actors.games", "viewer"])
def test_a_child_leaves_with_its_parent_during_its_imports_too(
    program: str, tmp_path: Path
) -> None:
    process = importing(tmp_path, program, "--leash")
    assert process.poll() is None
    process.communicate(timeout=PATIENCE)
    assert process.returncode == -signal.SIGTERM


def test_what_programs_import_first_loads_nothing_else_of_the_project() -> None:
    code = "import sys, common.process.lifeline; print(*sys.modules)"
    loaded = subprocess.check_output([sys.executable, "-c", code], cwd=ROOT, text=True).split()
    folders = {path.parent.name for path in ROOT.glob("*/__init__.py")}
    ours = {name for name in loaded if name.split(".")[0] in folders}
    assert ours == {"common", "common.process", "common.process.lifeline"}
    assert "logging" not in loaded


@pytest.mark.parametrize(
    "program", ["actors", "ale_robot", "deploy", "learner", "replay", "viewer"]
)
def test_ctrl_c_during_the_imports_ends_a_program_quietly(program: str, tmp_path: Path) -> None:
    process = importing(tmp_path, program)
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=PATIENCE) == ("", "")
    assert process.returncode == 130


@pytest.mark.parametrize("program", ["actors", "learner", "replay"])
def test_the_first_process_of_a_container_ends_at_sigterm_during_its_imports_too(
    program: str, tmp_path: Path
) -> None:
    container = ("unshare", "--user", "--map-root-user", "--pid", "--fork", "--kill-child")
    if shutil.which("unshare") is None or subprocess.run([*container, "true"]).returncode:
        pytest.skip("there are no namespaces here")
    process = importing(tmp_path, program, within=container)
    (first,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    os.kill(int(first), signal.SIGTERM)
    assert process.communicate(timeout=PATIENCE) == ("", "")
    assert process.returncode == 128 + signal.SIGTERM


def test_an_ignored_ctrl_c_stays_ignored() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        lifeline.leave_at_interrupt()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
