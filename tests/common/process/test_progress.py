"""How far a command is: lines for a log, a bar for a terminal."""

import io

import pytest

from common.process.progress import Progress
from tests.common.test_schedule import Now


def test_without_a_terminal_there_is_a_line_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    stream, now = io.StringIO(), Now()
    with Progress("filming", 600.0, stream=stream, now=now) as progress:
        for done in range(1, 26):
            now.seconds += 1.0
            progress.update(10.0 * done, note=f"{done} steps")
    told = [line.split(" ", 1)[1] for line in stream.getvalue().splitlines()]
    # 600 at 10 a second take a minute.
    assert told == [
        "filming: 17 %, 10 steps, 0:00:50 left",
        "filming: 33 %, 20 steps, 0:00:40 left",
    ]


def test_what_takes_long_to_begin_is_told_and_the_time_left_after_its_first_part() -> None:
    stream, now = io.StringIO(), Now()
    with Progress("evaluating", 4, "4 games", stream=stream, now=now) as progress:
        assert stream.getvalue().split(" ", 1)[1] == "evaluating: 0 %, 4 games\n"
        for games in (1, 2):  # they end together
            now.seconds += 60.0 if games == 1 else 0.5
            progress.update(games, note=f"{games} of 4 games")
        now.seconds += 30.0
        progress.update(3, note="3 of 4 games")
    told = [line.split(" ", 1)[1] for line in stream.getvalue().splitlines()]
    assert told[1:] == [
        "evaluating: 25 %, 1 of 4 games, 0:03:00 left",
        "evaluating: 75 %, 3 of 4 games, 0:00:31 left",
    ]


def test_an_end_that_nobody_knows_has_no_share() -> None:
    stream, now = io.StringIO(), Now()
    with Progress("playing", None, stream=stream, now=now) as progress:
        now.seconds += 10.0
        progress.update(3.0, note="3 s of play")
    assert stream.getvalue().split(" ", 1)[1] == "playing: 3 s of play\n"


def test_an_end_that_nobody_will_see_has_no_time_left() -> None:
    stream, now = io.StringIO(), Now()
    with Progress("recording", 2**63 - 1, stream=stream, now=now) as progress:
        for done in (1, 2):
            now.seconds += 10.0
            progress.update(done, note=f"{done} steps")
    told = [line.split(" ", 1)[1] for line in stream.getvalue().splitlines()]
    assert told == ["recording: 0 %, 1 steps", "recording: 0 %, 2 steps"]


def test_another_total_is_told() -> None:
    stream, now = io.StringIO(), Now()
    with Progress("evaluating", 4, stream=stream, now=now) as progress:
        now.seconds += 10.0
        progress.update(1, total=2)
    assert stream.getvalue().split(" ", 1)[1] == "evaluating: 50 %\n"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_in_a_terminal_there_is_a_bar_and_standard_output_stays_what_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TERM", "xterm")
    stream, now = Terminal(), Now()
    with Progress("filming", 600.0, "a long film", stream=stream, now=now) as progress:
        now.seconds += 10.0
        progress.update(300.0, note="halfway")
        print("game 1: score 3")
    assert capsys.readouterr().out == "game 1: score 3\n"
    assert "halfway" in stream.getvalue()
    assert "━" in stream.getvalue()
    assert "50 %" not in stream.getvalue()
    assert "a long film" not in stream.getvalue()  # a bar that fills the line wraps at ^C


class Broken(io.StringIO):
    def write(self, text: str) -> int:
        raise BrokenPipeError


def test_a_command_goes_on_when_nobody_reads_its_progress() -> None:
    now = Now()
    with Progress("filming", 600.0, stream=Broken(), now=now) as progress:
        now.seconds += 10.0
        progress.update(300.0)


def test_it_tells_on_standard_error(capsys: pytest.CaptureFixture[str]) -> None:
    now = Now()
    with Progress("filming", 600.0, now=now) as progress:
        now.seconds += 10.0
        progress.update(300.0)
    told = capsys.readouterr()
    assert (told.out, "filming: 50 %" in told.err) == ("", True)
