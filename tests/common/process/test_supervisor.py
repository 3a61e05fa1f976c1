"""Children: what they are given, how they end, and when one is started again."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

from common.errors import InputError
from common.process import lifeline
from common.process.supervisor import Child, Supervisor
from tests.clock import Clock
from tests.patience import PATIENCE

PYTHON = sys.executable
WAITS_FOR_LEASH = """import os, sys
sys.stdin.read()
print(os.getpriority(os.PRIO_PROCESS, 0), os.getpgrp() == os.getpid(), sys.argv[-1])
"""


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of a program that every child runs instead of Python."""
    file = tmp_path / "program"
    monkeypatch.setattr(sys, "executable", str(file))
    return file


def write(program: Path, script: str) -> None:
    program.write_text(f"#!{PYTHON}\n{script}\n")
    program.chmod(0o755)


@pytest.mark.parametrize("low_priority", [True, False])
def test_a_child_leaves_with_its_leash_and_yields_where_it_should(
    program: Path, tmp_path: Path, low_priority: bool
) -> None:
    write(program, WAITS_FOR_LEASH)
    log = tmp_path / "log"
    child = Child("m", leash=True, low_priority=low_priority, log=log)
    assert child.poll() is None
    child.end(PATIENCE)
    ours = os.getpriority(os.PRIO_PROCESS, 0)
    nice = min(ours + 10, 19) if low_priority else ours
    assert log.read_text().split() == [str(nice), "True", "--leash"]
    assert child.returncode == 0


def test_a_child_without_a_leash_is_asked_by_a_signal(program: Path) -> None:
    write(program, "import time; print('ready', flush=True); time.sleep(10_000)")
    child = Child("m", stdout=subprocess.PIPE)
    assert child.stdout is not None
    child.stdout.readline()
    child.end(PATIENCE)
    assert child.returncode == -15


def test_a_child_that_does_not_leave_is_killed(program: Path) -> None:
    write(
        program,
        "import signal, time\nsignal.signal(15, signal.SIG_IGN)\n"
        "print('ready', flush=True)\ntime.sleep(10_000)",
    )
    child = Child("m", stdout=subprocess.PIPE)
    assert child.stdout is not None
    child.stdout.readline()
    child.end(0.0)
    assert child.returncode == -9


@pytest.mark.parametrize(
    ("said", "last"),
    [("'one'); print('error: no room.'", "no room"), ("''", "nothing")],
)
def test_the_last_line_is_found_in_a_log_or_a_pipe(
    program: Path, tmp_path: Path, said: str, last: str
) -> None:
    write(program, f"import sys; sys.stdout = sys.stderr; print({said}); sys.exit(3)")
    logged = Child("m", log=tmp_path / "log")
    piped = Child("m", stderr=subprocess.PIPE)
    for child in (logged, piped):
        child.wait(PATIENCE)
    assert str(logged.failure("learner")) == f"the learner ended, and said: {last}."
    assert piped.last_line() == last
    piped.end()


def test_what_was_printed_before_an_error_is_not_the_last_line(
    program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    write(program, "import sys; print('a game'); print('error: no room.', file=sys.stderr)")
    child = Child("m", log=tmp_path / "log")
    child.wait(PATIENCE)
    assert child.last_line() == "no room"


def test_a_child_that_writes_much_to_a_piped_standard_error_is_not_held_up(program: Path) -> None:
    pipes = 16 * 65_536  # Linux holds up whoever writes more than 65,536 that nobody reads
    write(program, f"import sys; sys.stderr.write({pipes} * 'é' + '\\nno room'); print('done')")
    child = Child("m", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        assert child.wait(PATIENCE) == 0
        assert child.last_line() == "no room"
    finally:
        child.end(0.0)


def started(
    program: Path, tmp_path: Path, script: str, now: Callable[[], float] = time.monotonic
) -> Supervisor:
    """A supervisor of one actor that is this script."""
    write(program, script)
    start = partial(Child, "m", leash=True, log=tmp_path / "actor-1.log")
    return Supervisor({"actor-1": start}, now)


def notes_of(children: Supervisor, *, finished: bool = False) -> list[str]:
    """What is noted once the actor has ended."""
    children._children["actor-1"].wait(PATIENCE)
    return children.watch(finished=lambda: finished)


@pytest.mark.parametrize(
    ("script", "how"),
    [
        ("print('no room'); raise SystemExit(3)", "status 3"),
        ("print('no room'); raise SystemExit(0)", "status 0"),
        (
            "import os; print('no room', flush=True); os.kill(os.getpid(), 9)",
            "signal 9",
        ),
    ],
)
def test_a_child_that_cannot_start_is_given_up_with_its_last_line(
    program: Path, tmp_path: Path, script: str, how: str
) -> None:
    clock = Clock()
    children = started(program, tmp_path, script, clock)
    why = f"{how} (no room)" if how == "status 3" else how
    assert notes_of(children) == [f"actor-1 ended by {why}, started again"]
    assert notes_of(children) == [f"actor-1 ended by {why}, next try in 1 s"]
    clock.now += 1.0
    assert children.watch(finished=lambda: False) == ["actor-1 started again"]
    with pytest.raises(InputError, match=f"^actor-1 cannot start: .*{how} and said: no room "):
        notes_of(children)
    children.close()


def test_a_child_that_is_refused_is_given_up_at_once_however_slowly_it_starts(
    program: Path, tmp_path: Path
) -> None:
    clock = Clock()
    children = started(program, tmp_path, "print('error: a: do b.'); raise SystemExit(2)", clock)
    clock.now += 601.0  # it has worked
    assert notes_of(children) == ["actor-1 ended by status 2 (a: do b), started again"]
    clock.now += 100.0
    with pytest.raises(InputError) as error:
        notes_of(children)
    assert str(error.value) == f"actor-1 ended: a: do b (more in {tmp_path}/actor-1.log)."
    children.close()


def test_a_child_that_has_worked_may_end_often(program: Path, tmp_path: Path) -> None:
    clock = Clock()
    children = started(program, tmp_path, "raise SystemExit(0)", clock)
    for _ in range(4):
        clock.now += 601.0
        assert notes_of(children) == ["actor-1 ended by status 0, started again"]
    assert notes_of(children, finished=True) == []  # it left because the run is over
    children.close()


def test_pauses_between_restarts_grow_until_a_child_has_settled(
    program: Path, tmp_path: Path
) -> None:
    clock, worked = Clock(), 20.0
    children = started(program, tmp_path, "raise SystemExit(3)", clock)
    clock.now += worked
    assert notes_of(children) == ["actor-1 ended by status 3, started again"]
    for pause in (1, 2, 4, 8, 16, 32, 60, 60):
        clock.now += worked
        assert notes_of(children) == [f"actor-1 ended by status 3, next try in {pause} s"]
        clock.now += pause - 0.1
        assert children.watch(finished=lambda: False) == []
        clock.now += 0.2
        assert children.watch(finished=lambda: False) == ["actor-1 started again"]
    clock.now += 601.0
    assert notes_of(children) == ["actor-1 ended by status 3, started again"]
    clock.now += worked
    assert notes_of(children) == ["actor-1 ended by status 3, next try in 1 s"]
    children.close()


def test_a_child_whose_log_has_gone_is_started_again_with_a_new_one(
    program: Path, tmp_path: Path
) -> None:
    write(program, "print('no room'); raise SystemExit(3)")
    log = tmp_path / "logs" / "actor-1.log"
    children = Supervisor({"actor-1": partial(Child, "m", leash=True, log=log)})
    children._children["actor-1"].wait(PATIENCE)
    shutil.rmtree(log.parent)
    assert notes_of(children) == ["actor-1 ended by status 3, started again"]
    assert notes_of(children) == ["actor-1 ended by status 3 (no room), next try in 1 s"]
    children.close()


def test_neither_a_link_nor_a_pipe_is_taken_for_a_log(program: Path, tmp_path: Path) -> None:
    write(program, "print('a line')")
    (tmp_path / "linked").write_text("precious")
    (tmp_path / "link").symlink_to("linked")
    os.mkfifo(tmp_path / "pipe")
    for name in ("link", "pipe"):
        with pytest.raises(InputError, match=rf"^{tmp_path}/{name} cannot be written"):
            Child("m", log=tmp_path / name)
    assert (tmp_path / "linked").read_text() == "precious"


def test_a_start_that_the_system_refuses_is_tried_again_after_growing_pauses(
    program: Path, tmp_path: Path
) -> None:
    clock = Clock()
    children = started(program, tmp_path, "raise SystemExit(3)", clock)
    children._children["actor-1"].wait(PATIENCE)
    program.unlink()
    refused = "cannot be started (No such file or directory), next try in"
    assert notes_of(children) == [f"actor-1 ended by status 3, {refused} 1 s"]
    for pause, following in ((1, 2), (2, 4)):
        clock.now += pause - 0.1
        assert children.watch(finished=lambda: False) == []
        assert children.at_work() == {"actor-1"}
        clock.now += 0.2
        assert children.watch(finished=lambda: False) == [f"actor-1 {refused} {following} s"]
    write(program, "raise SystemExit(3)")
    clock.now += 4.0
    assert children.watch(finished=lambda: False) == ["actor-1 started again"]
    assert notes_of(children) == ["actor-1 ended by status 3, next try in 8 s"]
    children.close()


def test_a_child_that_pauses_is_on_its_way_unless_it_was_asked_to_leave(
    program: Path, tmp_path: Path
) -> None:
    clock = Clock()
    children = started(program, tmp_path, "raise SystemExit(3)", clock)
    for _ in range(2):
        notes_of(children)
    assert children.works("actor")
    assert not children.works("evaluator")
    assert children.at_work() == {"actor-1"}
    children.ask_to_leave()
    assert not children.works("actor")
    clock.now += 1.0
    assert children.watch(finished=lambda: False) == []
    children.close()


@pytest.mark.parametrize(("status", "again"), [(0, []), (3, ["actor-1 started again"])])
def test_a_child_that_pauses_when_the_work_is_finished_is_only_started_again_if_it_failed(
    program: Path, tmp_path: Path, status: int, again: list[str]
) -> None:
    """An evaluator that failed has the last test to play."""
    clock = Clock()
    children = started(program, tmp_path, f"raise SystemExit({status})", clock)
    for _ in range(2):
        notes_of(children)
    clock.now += 1.0
    assert children.watch(finished=lambda: True) == again
    assert again or not children.works("actor")
    children.close()


def test_each_start_has_its_own_time_to_get_to_work(program: Path, tmp_path: Path) -> None:
    clock = Clock()
    children = started(program, tmp_path, "raise SystemExit(3)", clock)
    clock.now = 1_000.0  # it worked for long
    notes_of(children)
    for pause in (1.0, 2.0):
        clock.now += 14.0
        notes_of(children)
        clock.now += pause
        children.watch(finished=lambda: False)
    clock.now += 14.0
    with pytest.raises(InputError, match="it ended 3 times"):
        notes_of(children)
    children.close()


def test_a_child_that_fails_at_the_end_is_started_again(program: Path, tmp_path: Path) -> None:
    children = started(program, tmp_path, "raise SystemExit(3)")
    assert notes_of(children, finished=True) == ["actor-1 ended by status 3, started again"]
    children.close()


def test_children_that_were_asked_to_leave_are_not_started_again(
    program: Path, tmp_path: Path
) -> None:
    children = started(program, tmp_path, WAITS_FOR_LEASH)
    assert children.works("actor")
    children.ask_to_leave()
    assert notes_of(children) == []
    assert not children.works("actor")
    children.close()


def test_children_have_as_long_as_each_gives_itself_to_leave(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given: list[float] = []
    child = SimpleNamespace(ask_to_leave=lambda: None, end=given.append)
    monkeypatch.setattr("common.process.supervisor.time.monotonic", lambda: 5.0)
    Supervisor({"a": lambda: child}).close()  # type: ignore[dict-item, return-value]
    assert given == [lifeline.GRACE]
