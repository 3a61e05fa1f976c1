"""How a program ends: exit codes, and one line for people."""

import errno
import logging
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from common.errors import InputError, MessageError, writing
from common.process.program_end import exit_on_input_error


@pytest.mark.parametrize(("returned", "status"), [(None, None), (0, 0), (3, 3)])
def test_a_program_exits_with_its_own_status(returned: int | None, status: int | None) -> None:
    with pytest.raises(SystemExit) as caught:
        exit_on_input_error(lambda: returned)
    assert caught.value.code == status


def test_an_input_error_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    def main() -> int:
        raise InputError("the port is taken: choose another.")

    with pytest.raises(SystemExit) as caught:
        exit_on_input_error(main)
    assert caught.value.code == 2
    assert capsys.readouterr() == ("", "error: the port is taken: choose another.\n")


def test_a_strangers_text_does_not_command_the_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in a card's settings, or in the key of a request."""
    root = logging.getLogger()
    monkeypatch.setattr(root, "handlers", [])  # pytest's; without any, Python logs to the terminal

    def main() -> int:
        logging.getLogger("x").warning("a request at %s", "ε/\x1b[2J\x9b2J")
        raise InputError("there is no \x1b]0;owned\x07\u202e.\n\tε − 1")

    with pytest.raises(SystemExit):
        exit_on_input_error(main)
    assert capsys.readouterr().err == (
        r"a request at ε/\x1b[2J\x9b2J" + "\n"
        r"error: there is no \x1b]0;owned\x07\u202e." + "\n\tε − 1\n"
    )


@pytest.mark.parametrize(
    ("told", "columns"), [("0", 80), ("3", 80), ("19", 80), ("20", 20), ("100", 100)]
)
def test_a_terminal_without_columns_has_some(
    told: str, columns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In three of them ``--help`` went on for ever, and in none a table was empty."""
    monkeypatch.setenv("COLUMNS", told)
    with pytest.raises(SystemExit) as caught:
        exit_on_input_error(lambda: Console().width)
    assert caught.value.code == columns


def test_a_program_is_as_wide_as_its_terminal_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    with pytest.raises(SystemExit):
        exit_on_input_error(lambda: None)
    assert "COLUMNS" not in os.environ


def test_ctrl_c_is_no_error(capsys: pytest.CaptureFixture[str]) -> None:
    def main() -> int:
        raise KeyboardInterrupt

    with pytest.raises(SystemExit) as caught:
        exit_on_input_error(main)
    assert caught.value.code == 130
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EROFS])
def test_what_a_later_try_may_write_has_an_exit_code_of_its_own(number: int) -> None:
    def main() -> int:
        with writing(Path("r")):
            raise OSError(number, os.strerror(number))

    with pytest.raises(SystemExit) as caught:
        exit_on_input_error(main)
    assert caught.value.code == os.EX_TEMPFAIL


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_is_one_line(number: int, capsys: pytest.CaptureFixture[str]) -> None:
    def main() -> int:
        raise OSError(number, os.strerror(number))

    with pytest.raises(SystemExit) as caught:
        exit_on_input_error(main)
    assert caught.value.code == os.EX_TEMPFAIL
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith("error: the disk is full: free some space")
    assert told.err.count("\n") == 1


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (
            PermissionError(errno.EACCES, "Permission denied", "/r"),
            "/r: Permission denied: fix that",
        ),
        (OSError(errno.EIO, "Input/output error"), "the system: Input/output error: fix that"),
        (OSError("odd"), "the system: odd: fix that"),
        (OSError(errno.EFBIG, "File too large"), r"a file .* \(ulimit -f\): raise the limit"),
    ],
)
def test_what_the_system_refuses_is_one_line(
    error: OSError, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def main() -> int:
        raise error

    with pytest.raises(SystemExit) as caught:
        exit_on_input_error(main)
    assert caught.value.code == 2
    told = capsys.readouterr().err
    assert re.match(f"error: {sentence}, then run the command again, that of a run with", told)
    assert told.count("\n") == 1


@pytest.mark.parametrize("number", [errno.EMFILE, errno.ENFILE, errno.ENOMEM])
def test_a_process_that_runs_short_is_started_again(number: int) -> None:
    def main() -> int:
        raise OSError(number, os.strerror(number))

    with pytest.raises(SystemExit) as caught:
        exit_on_input_error(main)
    assert caught.value.code == 1


@pytest.mark.parametrize(
    "error",
    [
        ConnectionResetError(errno.ECONNRESET, "Connection reset by peer"),
        ConnectionRefusedError("the robot refuses"),
        TimeoutError("timed out"),
        OSError(errno.EHOSTUNREACH, "No route to host"),
        OSError(errno.ENETUNREACH, "Network is unreachable"),
    ],
)
def test_a_process_that_lost_a_connection_is_started_again(error: OSError) -> None:
    """Exit code 2 of an actor ends a local run at once."""

    def main() -> int:
        raise error

    with pytest.raises(SystemExit) as caught:
        exit_on_input_error(main)
    assert caught.value.code == 1


def test_other_errors_are_bugs_and_keep_their_traceback() -> None:
    def main() -> int:
        raise MessageError("not caught")

    with pytest.raises(MessageError, match="not caught"):
        exit_on_input_error(main)


PRINTS = """
import sys
from pathlib import Path
from common.process.program_end import exit_on_input_error

def main():
    sys.stdin.read()
    print("a line")
    {end}

exit_on_input_error(main)
"""


def test_a_name_that_is_not_utf_8_is_printed_escaped() -> None:
    code = PRINTS.format(end='print("wrote x\\udcff.png")')
    told = subprocess.run(
        [sys.executable, "-c", code],
        stdin=subprocess.DEVNULL,
        env={**os.environ, "PYTHONIOENCODING": "utf-8:strict"},
        capture_output=True,
        check=True,
        text=True,
    )
    assert (told.stdout, told.stderr) == ("a line\nwrote x\\udcff.png\n", "")


def test_the_last_line_of_a_program_that_failed_is_its_error() -> None:
    """What Python did not free at its end, as an emulator in a cycle, nanobind would tell later."""
    code = """
from actors.envs.emulator import Emulator
from common.process.program_end import exit_on_input_error

class Owner:
    def __init__(self):
        self.itself = self
        self.emulator = Emulator("pong", 0)

def main():
    owner = Owner()
    raise ZeroDivisionError("the arm broke")

exit_on_input_error(main)
"""
    told = subprocess.run([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
    assert told.returncode == 1
    assert told.stderr.splitlines()[-1] == "ZeroDivisionError: the arm broke"


@pytest.mark.parametrize("end", ["", "sys.exit(0)", "sys.stdout.flush()"])
def test_output_that_nobody_reads_ends_a_program_in_silence(end: str) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", PRINTS.format(end=end)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    process.stdout.close()
    _, errors = process.communicate()
    assert (process.returncode, errors) == (141, b"")


def test_a_broken_pipe_that_is_not_the_output_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    def main() -> None:
        raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))

    with pytest.raises(SystemExit) as caught:
        exit_on_input_error(main)
    assert caught.value.code == 1
    assert "Broken pipe" in capsys.readouterr().err


def test_the_status_of_an_error_that_nobody_can_read_is_its_own() -> None:
    """A supervisor starts a program again that ends by another status."""
    code = """
import sys
from common.errors import InputError
from common.process.program_end import exit_on_input_error

def main():
    sys.stdin.read()
    raise InputError("no")

exit_on_input_error(main)
"""
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stderr is not None
    process.stderr.close()
    process.communicate()
    assert process.returncode == 2


CLOSED = """
import os, sys
from pathlib import Path
from common.process.program_end import exit_on_input_error

def main():
    print("a line")
    print("an error", file=sys.stderr)
    sys.stdin.read()
    file = Path(sys.argv[1]).open("w")
    assert file.fileno() > 2, file.fileno()
    os.system("echo a child")
    return 7

exit_on_input_error(main)
"""


@pytest.mark.parametrize(
    ("first", "end", "errors"), [(0, 3, b""), (1, 2, b"an error\n"), (2, 3, b"")]
)
def test_a_program_works_where_streams_were_closed_when_it_began(
    tmp_path: Path, first: int, end: int, errors: bytes
) -> None:
    file = tmp_path / "file"
    process = subprocess.run(
        [sys.executable, "-c", CLOSED, str(file)],
        check=False,
        preexec_fn=lambda: os.closerange(first, end),
        stdin=subprocess.DEVNULL,
        capture_output=True,
    )
    assert (process.returncode, process.stderr) == (7, errors)
    assert file.read_bytes() == b""
