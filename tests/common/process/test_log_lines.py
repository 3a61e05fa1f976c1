"""Lines for people as they are, or as JSON with time, level, role and figures."""

import json
import logging
import math
import re
import subprocess
import sys
from pathlib import Path

import pytest

from common.errors import InputError
from common.process import log_lines
from common.process.log_lines import Seldom, kept_log, line
from tests.paths import ROOT

CODE = """
import logging, math, sys
from common.errors import InputError
from common.process.program_end import exit_on_input_error
from common.process.log_lines import line, say_json
say_json("replay")
values = {"a/b": 1, "c/d": math.nan, "e/f": None}
print(line("ε is\\n1", values=values, stamped=True), file=sys.stderr)
logging.getLogger("x").warning("%d chunks", 3)
def fail():
    raise InputError("there is none: make one.")
exit_on_input_error(fail)
"""


def test_lines_are_as_they_are_by_default() -> None:
    assert line("ε is 1", "warning", {"a/b": math.inf}) == "ε is 1"
    assert re.fullmatch(r"\d\d:\d\d:\d\d ε is 1", line("ε is 1", stamped=True))


def test_lines_logs_and_errors_as_json() -> None:
    done = subprocess.run(
        [sys.executable, "-c", CODE], cwd=ROOT, capture_output=True, text=True, check=False
    )
    told = [json.loads(each) for each in done.stderr.splitlines()]
    assert done.returncode == 2
    assert [(each["level"], each["message"]) for each in told] == [
        ("info", "ε is\n1"),
        ("warning", "3 chunks"),
        ("error", "error: there is none: make one."),
    ]
    assert told[0]["values"] == {"a/b": 1, "c/d": None, "e/f": None}
    assert {each["role"] for each in told} == {"replay"}
    assert all(each["time"].endswith("Z") and len(each["time"]) == 24 for each in told)


def test_a_run_keeps_what_was_logged_and_said(tmp_path: Path) -> None:
    path = tmp_path / "logs" / "learner.jsonl"
    log = logging.getLogger("kept")
    for name in ("a", "b"):  # a second process goes on in the file of the first
        with kept_log(path, "learner") as keep:
            keep(f"{name} joined: 100 %")
            log.warning("%s is slow", name)
        log.warning("said afterwards")
    told = [json.loads(each) for each in path.read_text().splitlines()]
    assert [(each["level"], each["message"]) for each in told] == [
        ("info", "a joined: 100 %"),
        ("warning", "a is slow"),
        ("info", "b joined: 100 %"),
        ("warning", "b is slow"),
    ]
    assert {each["role"] for each in told} == {"learner"}


def test_a_warning_is_still_on_the_terminal(tmp_path: Path) -> None:
    code = (
        "import logging, pathlib, sys; from common.process.log_lines import kept_log\n"
        "with kept_log(pathlib.Path(sys.argv[1]), 'x'): logging.getLogger('y').warning('late')"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "log")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stderr == "late\n"


@pytest.mark.parametrize("error", [InputError("it is full."), ValueError()])
def test_the_error_that_ends_the_block_is_kept(tmp_path: Path, error: Exception) -> None:
    with pytest.raises(type(error)), kept_log(tmp_path / "log", "x"):
        raise error
    told = json.loads((tmp_path / "log").read_text())
    assert (told["level"], told["message"]) == ("error", str(error) or "ValueError()")


def test_the_kept_log_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_lines, "_MAX_BYTES", 2_000)
    with kept_log(tmp_path / "log", "x") as keep:
        for index in range(200):
            keep(f"event {index}")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log", "log.1"]
    assert all(path.stat().st_size <= 2_000 for path in tmp_path.iterdir())
    assert "event 199" in (tmp_path / "log").read_text()


def test_a_full_disk_costs_lines_alone() -> None:
    with kept_log(Path("/dev/full"), "x") as keep:
        keep("nobody hears")


def test_without_a_folder_lines_are_lost_alone(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    handlers = list(logging.getLogger().handlers)
    with kept_log(tmp_path / "file" / "log", "x") as keep:
        keep("nobody hears")
    assert logging.getLogger().handlers == handlers


def test_it_writes_nothing_where_a_link_leads(tmp_path: Path) -> None:
    (tmp_path / "log").symlink_to(tmp_path / "elsewhere")
    with kept_log(tmp_path / "log", "x") as keep:
        keep("nobody hears")
    assert not (tmp_path / "elsewhere").exists()


def test_the_same_is_logged_once_in_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("common.process.log_lines.time.monotonic", lambda: now[0])
    seldom = Seldom()

    def passes(subject: str, reason: str, level: int = logging.WARNING) -> bool:
        args = (subject, reason)
        return bool(seldom.filter(logging.LogRecord("x", level, "", 0, "%s: %s", args, None)))

    assert passes("a", "1")
    assert not passes("a", "2")  # whatever a stranger makes of the reason
    assert passes("b", "1")
    assert passes("a", "1", logging.ERROR)
    now[0] = 10.0
    assert passes("a", "2")


def test_what_was_said_is_remembered_of_a_bounded_number_of_subjects() -> None:
    """Strangers choose their names."""
    seldom = Seldom()
    for number in range(3 * log_lines._MAX_SUBJECTS):
        record = logging.LogRecord("x", logging.WARNING, "", 0, "%s", (f"a{number}",), None)
        assert seldom.filter(record)
        assert len(seldom._said) <= log_lines._MAX_SUBJECTS
