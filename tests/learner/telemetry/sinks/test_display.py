"""The live screen, drawn for many sizes and on a real pseudo-terminal, and the plain lines."""

import contextlib
import fcntl
import io
import math
import os
import pty
import re
import struct
import sys
import termios
import threading
from dataclasses import replace
from typing import Any, TextIO

import pytest
from rich.cells import cell_len
from rich.console import Console

from common.metrics import Metric, Value
from common.protocol.actor_stats import ActorStats
from common.protocol.run_status import HealthCheck
from common.settings.conditions import PlayConfig
from common.settings.presets import PRESETS
from learner.telemetry.health_checks import judge
from learner.telemetry.panels import panels_of
from learner.telemetry.sinks import screen
from learner.telemetry.sinks.display import LiveDisplay, PlainDisplay, open_display
from learner.telemetry.sinks.screen import Screen
from learner.telemetry.snapshot import ActorView, Snapshot
from tests.learner.telemetry.snapshots import changed, snapshot

HANDS: dict[str, Value] = {
    "hands/press_measured": 1_224,
    "hands/press_p50": 50.0,
    "hands/press_p99": 1000 / 15,
    "hands/press_watched": 1000 / 15,
}


def checks(valid_frame_share: float) -> tuple[HealthCheck, ...]:
    return judge(
        {
            "play/valid_frame_share": valid_frame_share,
            "learning/pixel_deviation": 28.4,
            "learning/held_out_std": 0.2314,
            "learning/relative_td_error": None,
            "play/press_match_share": 0.873,
            "stream/chunks_refused": 0,
            "stream/chunks_excess": 0,
            **HANDS,
        },
        replace(PRESETS["robot"], play=PlayConfig()),
    )


def actors(count: int, **counters: Any) -> tuple[ActorView, ...]:
    return tuple(
        ActorView(
            stats=ActorStats(
                f"actor-{number}",
                "actor",
                steps=312_456 + number,
                steps_per_second=46.6,
                epsilon=0.1,
                **counters,
            ),
            alive=number != count - 1,
        )
        for number in range(count)
    )


STATUS = snapshot(
    {
        "run/run": "pong-robot-3",
        "run/preset": "robot",
        "run/env": "robot",
        "run/device": "cuda:0 (NVIDIA H200)",
        "run/phase": "training",
        "run/seconds": 187_654.0,
        "run/seconds_left": 872.0,
        "run/agent_steps": 10_402_560,
        "run/steps_goal": 50_000_000,
        "run/epoch": 42,
        "run/phase_length": 250_000,
        "run/phase_steps": 152_560,
        "learning/epsilon": 0.1,
        "learning/updates": 2_588_140,
        "learning/loss": 0.000829,
        "learning/mean_max_q": 1.3931,
        "learning/held_out_std": 0.2314,
        "play/games": 11_204,
        "play/train_reward": 17.03,
        "play/test_reward": 18.42,
        "play/test_epoch": 41,
        "play/random_reward": -20.09,
        "stream/steps_per_second": 186.3,
        "learning/updates_per_second": 46.6,
        "stream/samples_per_insert": 8.003,
        "stream/staleness_p50": 38.0,
        "stream/staleness_p95": 74.0,
        "stream/stored": 300_000,
        "stream/capacity": 1_000_000,
        "stream/actors_alive": 3,
        "stream/actors_present": 4,
        "stream/chunks_made": 162_540,
        "stream/chunks_acked": 162_536,
        "stream/chunks_retried": 12,
        "hands/release_p50": 50 / 3,
        "hands/release_p99": math.inf,
        **HANDS,
    },
    actors=actors(4),
    checks=checks(0.9994),
    rewards={"test": (-20.1, -15.0, 3.0, 18.42)},
    notes=("checkpoint written", "actor-3 was lost, restarted"),
)
EMPTY = snapshot({})


def drawn(status: Snapshot, width: int = 80, height: int = 24) -> list[str]:
    file = io.StringIO()
    console = Console(file=file, width=width, height=height, force_terminal=True, color_system=None)
    console.print(Screen(status), end="")
    return re.sub(r"\x1b\[[0-9;]*m", "", file.getvalue()).split("\n")


@pytest.mark.parametrize("status", [STATUS, EMPTY], ids=["full", "empty"])
@pytest.mark.parametrize("width", [20, 60, 79, 80, 107, 120, 300])
@pytest.mark.parametrize("height", [2, 10, 24, 25, 31, 40, 70])
def test_screen_stays_within_the_terminal(status: Snapshot, width: int, height: int) -> None:
    crowded = replace(status, actors=actors(30), checks=checks(0.3), notes=("a note " * 50,) * 20)
    for one in (status, crowded):
        lines = drawn(one, width, height)
        assert len(lines) <= height - 1
        assert max(map(cell_len, lines)) <= width


def test_a_run_without_actors_tells_how_to_start_one() -> None:
    empty = changed(EMPTY, {"run/join": "ale-robot join --connect tcp/h:1"}, actors=())
    assert "start one: ale-robot join --connect tcp/h:1" in "\n".join(drawn(empty, 120, 40))
    assert "none yet" in "\n".join(drawn(EMPTY))  # local mode starts them
    assert "start one" not in "\n".join(drawn(STATUS))


@pytest.mark.parametrize("size", [(60, 24), (80, 24), (120, 40), (200, 50)])
@pytest.mark.parametrize("status", [STATUS, EMPTY], ids=["full", "empty"])
def test_the_address_of_the_page_stays_on_the_screen(
    status: Snapshot, size: tuple[int, int]
) -> None:
    page: dict[str, Value] = {"run/page": "http://127.0.0.1:8080/"}
    crowded = replace(status, actors=actors(30), notes=("a note",) * 20)
    for one in (status, crowded):
        with_it, without = drawn(changed(one, page), *size), drawn(one, *size)
        (line,) = (line for line in with_it if "127.0.0.1" in line)
        assert line.strip() == "watch the run at http://127.0.0.1:8080/"
        # It takes an empty line, so that nothing else moves or is lost.
        assert without[with_it.index(line)].strip() == ""
        assert [each for each in with_it if each != line] == [
            each for at, each in enumerate(without) if at != with_it.index(line)
        ]


def test_a_wide_screen_tells_what_the_learner_takes_of_its_machine() -> None:
    taken: dict[str, Value] = {"run/busy_cores": 1.404, "run/memory_bytes": 740_400_000}
    told = "cuda:0 (NVIDIA H200), 140 % CPU, 740 MB"
    assert drawn(changed(STATUS, taken), 120, 40)[0].endswith(told)
    assert drawn(changed(STATUS, taken))[0].endswith("cuda:0 (NVIDIA H200)")


def test_a_wide_screen_tells_what_is_taken_of_the_gpu() -> None:
    taken: dict[str, Value] = {
        "run/busy_cores": 0.5,
        "run/memory_bytes": 740_400_000,
        "run/gpu_memory_bytes": 1_870_000_000,
        "run/gpu_capacity_bytes": 81_559_000_000,
    }
    told = "NVIDIA H200), 50 % CPU, 740 MB, GPU 1,870 of 81,559 MB"
    assert drawn(changed(STATUS, taken), 120, 40)[0].endswith(told)
    told = "NVIDIA H200), 50 % CPU, 740 MB, GPU 83 %, 1,870 of 81,559 MB"
    assert drawn(changed(STATUS, taken | {"run/gpu_utilisation": 0.83}), 120, 40)[0].endswith(told)


def test_what_went_wrong_with_time_is_shown() -> None:
    assert "late" not in "\n".join(drawn(STATUS, 132, 40))
    late, waited, well = (
        actors(1, missed_deadlines=missed, late_frames=frames, waits_given_up=waits)[0]
        for missed, frames, waits in ((1_200, 34, 0), (0, 0, 56), (0, 0, 0))
    )
    named = tuple(
        replace(each, alive=True, stats=replace(each.stats, name=f"actor-{number}"))
        for number, each in enumerate((late, waited, well))
    )
    # Of actors that are gone, too.
    totals: dict[str, Value] = {
        "stream/actors_alive": 3,
        "stream/actors_present": 3,
        "actors/missed_deadlines": 1_200,
        "actors/late_frames": 34,
        "actors/waits_given_up": 56,
    }
    status = changed(STATUS, totals, actors=named)
    assert "Actors 3/3, 1.2k late, 56 gave up " in "\n".join(drawn(status))
    wide = drawn(status, 132, 40)
    (row,) = (line for line in wide if "actor-0" in line)
    assert "0 retried, 1.2k late " in row
    (row,) = (line for line in wide if "actor-1" in line)
    assert "0 retried, 56 gave up " in row
    (row,) = (line for line in wide if "actor-2" in line)
    assert "0 retried " in row


def test_actors_that_have_not_joined_yet_are_starting() -> None:
    early: dict[str, Value] = {
        "stream/actors_alive": 0,
        "stream/actors_present": 0,
        "stream/actors_starting": 2,
    }
    status = changed(STATUS, early, actors=())
    assert "Actors 0/0, 2 starting " in "\n".join(drawn(status))
    (line,) = Recorder().said(status)
    assert " | 0 of 0 actors, 2 starting | " in line


def test_every_figure_is_there_at_80_by_24() -> None:
    text = "\n".join(drawn(STATUS))
    for pattern in (
        r"ALE-Robot +pong +run pong-robot-3 .* robot preset · cuda:0 \(NVIDIA H200\)",
        r"Epoch 42 .* 61 % +152,560 of 250,000 steps +14:32 left",
        r"Run .* 20 % +10,402,560 of 50,000,000 steps +2 d 04:07 so far",
        r"Replay .* 30 % +300,000 of 1,000,000 steps",
        r"test, epoch 41 +18\.42 +mean max-Q +1\.393 +steps/s +186\.3",
        r"train +17\.03 +its deviation +0\.2314 +samples/insert +8\.00 → 8",
        r"random policy +−20\.09 +loss +0\.0008290 +stale p50/95 +38/74 upd\.",
        r"games +11,204 +updates +2,588,140 +chunks acked +162,536",
        r"release p50/99 +17/∞ ms +updates/s +46\.6 +retried +12",
        r"press p50/99 +50/67 ms +exploration ε +0\.100 +duplicate +0",
        r"test −20\.1 … 18\.4 +▁",
        r"Actors, 3 of 4 alive .* Health checks, 1 open, 6 green",
        r"○ actor-3 +312,459 +lost +✓ valid frames +0\.9994 +≥ 0\.99",
        r"● actor-0 +312,456 46\.6/s +✓ pixel deviation +28\.40 +> 1",
        r"· relative TD error +– +< 1",
        r"✓ press p99 ms +66\.67 +≤ 133\.3",
        r"✓ refused chunks +0 +?= 0",
        r"checkpoint written",
        r"actor-3 was lost, restarted",
    ):
        assert re.search(pattern, text), pattern


@pytest.mark.parametrize("width", [60, 79])
def test_every_figure_is_there_at_60_by_24(width: int) -> None:
    lines = drawn(STATUS, width)
    text = "\n".join(lines)
    assert "…" not in text.replace("20.1 … 18.4", "")
    for pattern in (
        r"ALE-Robot +pong +run pong-robot-3 +robot preset",
        r"Epoch 42 +61 % +152,560 of 250,000 +14:32 left",
        r"Run +20 % +10,402,560 of 50,000,000 +2 d 04:07 so far",
        r"Replay +30 % +300,000 of 1,000,000",
        r"test, epoch 41 +18\.42 +mean max-Q +1\.393",
        r"press p50/99 +50/67 ms +exploration ε +0\.100",
        r"test −20\.1 … 18\.4 +▁",
        r"Stream ─.* Actors, 3 of 4 alive ─",
        r"steps/s +186\.3 +○ actor-3 +312,459 +lost",
        r"samples/insert +8\.00 → 8 +● actor-0 +312,456 46\.6/s",
        r"duplicate +0",
        r"Health checks, 1 open, 6 green",
        r"checkpoint written",
        r"actor-3 was lost, restarted",
    ):
        assert re.search(pattern, text), pattern
    assert len(lines) == 23
    endless = changed(STATUS, {"run/steps_goal": None})
    assert re.search(r"Run +10,402,560 steps +2 d", "\n".join(drawn(endless, width)))


@pytest.mark.parametrize("width", [80, 120])
def test_a_run_that_will_end_tells_when(width: int) -> None:
    ending = changed(STATUS, {"run/seconds_to_goal": 3_720.0})
    assert re.search(r"Run .* 2 d 04:07, 1:02:00 left *$", drawn(ending, width)[2])


@pytest.mark.parametrize(("height", "checked", "shown"), [(24, 0, 5), (28, 4, 5), (33, 7, 8)])
def test_a_taller_narrow_screen_shows_checks_and_then_more_actors(
    height: int, checked: int, shown: int
) -> None:
    crowded = replace(STATUS, actors=actors(8))
    text = "\n".join(drawn(crowded, 60, height))
    assert len(re.findall(r"^[✓·] ", text, re.MULTILINE)) == checked
    assert len(re.findall(r"[●○] actor-\d", text)) == shown
    assert "actor-3 was lost, restarted" in text


@pytest.mark.parametrize(("height", "shown"), [(24, 6), (36, 8), (38, 10), (45, 10)])
def test_a_taller_screen_shows_further_figures_of_a_panel(
    height: int, shown: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    panels = panels_of(STATUS.values)
    figures = [
        Metric(f"learning/extra_{place}", "none", ".3", "", f"extra {place}", ("Learning", place))
        for place in range(1, 11)
    ]
    monkeypatch.setattr(screen, "panels_of", lambda _: {**panels, "Learning": figures})
    monkeypatch.setattr(screen, "label_and_text", lambda metric, _: (metric.label, "1.000"))
    lines = drawn(STATUS, 120, height)
    assert len(re.findall(r"extra \d+ ", "\n".join(lines))) == shown
    assert "actor-3 was lost, restarted" in "".join(lines)  # they push nothing out


def test_red_check_is_told_with_its_reason() -> None:
    text = "\n".join(drawn(replace(STATUS, checks=checks(0.31))))
    assert "Health checks, 1 red, 1 open, 5 green" in text
    assert re.search(r"✗ valid frames +0\.3100 +≥ 0\.99", text)
    assert "✗ valid frames: the screen is not found in the camera's picture" in text
    assert "actor-3 was lost, restarted" in text


@pytest.mark.parametrize("size", [(60, 19), (80, 18), (80, 20), (120, 23)])
def test_a_low_screen_keeps_what_is_wrong(size: tuple[int, int]) -> None:
    text = "\n".join(drawn(replace(STATUS, actors=actors(8), checks=checks(0.31)), *size))
    assert "Health checks, 1 red" in text
    assert "✗ valid frames: the screen is not found in the camera's " in text
    refused = STATUS.checks[-1]._replace(passed=False)
    text = "\n".join(drawn(replace(STATUS, checks=(*STATUS.checks[:-1], refused)), *size))
    assert f"✗ {refused.name}: actors send what the replay " in text
    assert size[0] < 80 or re.search(r"✗ refused chunks +0 += 0", text)


def test_numbers_are_whole_where_labels_have_no_room() -> None:
    wide: dict[str, Value] = {
        "play/train_reward": 12_345.67,
        "play/test_reward": -123_456.78,
        "learning/mean_max_q": -12_345.678,
        "hands/release_p50": 350 / 3,
        "hands/release_p99": 400 / 3,
        "stream/staleness_p95": 12_345.0,
    }
    text = "\n".join(drawn(changed(STATUS, wide)))
    for told in ("−123,456.78", "12,345.67", "−12,345.678", "117/133 ms", "38/12,345 upd."):
        assert re.search(rf" {told}( |$)", text, re.MULTILINE), told
    assert re.search(r"press p50/99 +50/67 ms", text)  # a label is cut beside such a number only


def test_warm_up_has_its_own_bar() -> None:
    text = "\n".join(drawn(changed(EMPTY, {"run/phase_steps": 2_500, "run/seconds_left": 90.0})))
    assert re.search(r"Warm-up .* 25 % +2,500 of 10,000 steps +01:30 left", text)
    assert "no epoch is over yet" in text
    assert re.search(r"^test +– .*^train +– .*^random policy +– ", text, re.MULTILINE | re.DOTALL)


def test_the_axis_of_one_epoch_is_around_its_reward() -> None:
    one = changed(replace(STATUS, rewards={"test": (16.0,)}), {"play/random_reward": None})
    text = "\n".join(drawn(one, 120, 45))
    assert re.search(r"^17\.0 .*^15\.0 ", text, re.MULTILINE | re.DOTALL)
    assert "test 16.0 … 16.0" in "\n".join(drawn(one))


def test_more_room_shows_more_actors() -> None:
    crowded = replace(STATUS, actors=actors(12))
    small, tall = "\n".join(drawn(crowded)), "\n".join(drawn(crowded, 120, 45))
    assert "and 6 more" in small
    assert "○ actor-11" in small  # the lost one is not among those left out
    assert len(re.findall(r"actor-\d+ ", tall)) >= 12
    assert "more" not in tall
    assert "Test reward by epoch" in tall


class Terminal:
    """A pseudo-terminal of 24 × 80, read all the while from the side where a person would sit."""

    def __init__(self) -> None:
        self._reader, writer = pty.openpty()
        fcntl.ioctl(writer, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        self.stream: TextIO = open(writer, "w", encoding="utf-8")  # noqa: SIM115
        self._data = b""
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        with contextlib.suppress(OSError):  # how Linux tells that nobody writes any more
            while block := os.read(self._reader, 65_536):
                self._data += block

    def text(self) -> str:
        """Close the terminal; all that was written to it."""
        self.stream.close()
        self._thread.join(60)
        os.close(self._reader)
        return self._data.decode()


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    for name in ("NO_COLOR", "COLUMNS", "LINES", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    return Terminal()


def test_terminal_is_given_back_after_an_exception(terminal: Terminal) -> None:
    before = sys.stdout, sys.stderr
    display = open_display(terminal.stream)
    assert isinstance(display, LiveDisplay)

    def fail() -> None:
        with display:
            display.write(changed(EMPTY, {"run/run": "shown"}))
            print("printed by others")
            raise RuntimeError("a fault")

    with pytest.raises(RuntimeError, match="a fault"):
        fail()
    assert (sys.stdout, sys.stderr) == before
    written = terminal.text()
    assert "\x1b[?25l" in written
    assert written.rindex("\x1b[?25h") > written.rindex("\x1b[?25l")
    assert "run shown" in written
    assert written.count("printed by others") == 1
    # What others print moves the screen down: it is drawn once more below.
    assert "run shown" in written[written.index("printed by others") :]


def test_live_lines_stay_above_the_screen(terminal: Terminal) -> None:
    with open_display(terminal.stream) as display:
        display.write(EMPTY)
        display.line("files in runs/pong-1 [not markup]")
    written = terminal.text()
    assert "files in runs/pong-1 [not markup]" in written
    assert written.rindex("ALE-Only") > written.index("files in")


def test_resized_terminal_is_cleared_once(terminal: Terminal) -> None:
    with open_display(terminal.stream) as display:
        display.write(EMPTY)
        fcntl.ioctl(terminal.stream, termios.TIOCSWINSZ, struct.pack("HHHH", 12, 80, 0, 0))
        display.write(EMPTY)
        display.write(EMPTY)
    before, after = terminal.text().split("\x1b[2J")
    assert "Health checks, none yet" in before
    assert "Checks" not in after  # no room for so many lines
    assert after.count("run pong-1") == 3  # two drawn here and one as it is left


class Fragile(io.StringIO):
    """A stream that fails once it is told to, as a terminal does that was closed."""

    error: OSError | None = None

    def write(self, text: str) -> int:
        if self.error is not None:
            raise self.error
        return super().write(text)


def test_who_said_goodbye_has_left_and_is_not_lost() -> None:
    gone = replace(actors(1)[0], alive=False)
    left = replace(gone, stats=replace(gone.stats, leaving=True))
    for actor, word in ((gone, "lost"), (left, "left")):
        text = "\n".join(drawn(replace(STATUS, actors=(actor,))))
        assert re.search(rf"○ actor-0 +312,456 +{word} ", text)


@pytest.mark.parametrize("error", [BrokenPipeError(), OSError(5, "Input/output error")])
def test_lost_reader_of_a_pipe_does_not_stop_the_learner(error: OSError) -> None:
    stream = Fragile()
    with PlainDisplay(stream) as display:
        display.line("start")
        stream.error = error
        display.write(STATUS)
        display.line("end")
    assert stream.getvalue()[9:] == "start\n"


@pytest.mark.parametrize("from_the_start", [True, False])
def test_closed_terminal_does_not_stop_the_learner(from_the_start: bool) -> None:
    stream = Fragile()
    before = sys.stdout
    hung_up = OSError(5, "Input/output error")
    if from_the_start:
        stream.error = hung_up
    with LiveDisplay(Console(file=stream, force_terminal=True, width=80, height=24)) as display:
        display.write(STATUS)
        stream.error = hung_up
        display.write(STATUS)
        display.line("end")
    assert sys.stdout is before


@pytest.mark.parametrize("term", ["dumb", ""])
def test_dumb_terminal_gets_lines(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch, term: str
) -> None:
    monkeypatch.setenv("TERM", term)
    assert isinstance(open_display(terminal.stream), PlainDisplay)
    assert terminal.text() == ""


def test_file_gets_lines_whatever_the_environment_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    assert isinstance(open_display(io.StringIO()), PlainDisplay)


class Recorder:
    """A plain display with a clock set by hand; `said` gives the new lines without the time."""

    def __init__(self) -> None:
        self.now = 0.0
        self.stream = io.StringIO()
        self.display = PlainDisplay(self.stream, now=lambda: self.now)

    def said(self, status: Snapshot) -> list[str]:
        start = self.stream.tell()
        self.display.write(status)
        lines = self.stream.getvalue()[start:].splitlines()
        assert all(re.match(r"\d\d:\d\d:\d\d ", line) for line in lines)
        return [line[9:] for line in lines]


def test_plain_line_has_the_figures() -> None:
    assert Recorder().said(STATUS) == [
        "epoch 42 61 %, 14:32 left | 10,402,560 steps"
        " | reward train 17.03 test 18.42 random -20.09 | max-Q 1.393 | loss 0.0008290"
        " | 46.6 updates/s | epsilon 0.100 | press 50/67 ms | release 17/never ms | 186.3 steps/s"
        " | 8.00 samples/insert, target 8 | staleness 38/74 updates | 3 of 4 actors"
        " | health checks 1 open, 6 green"
    ]


def test_plain_line_tells_what_went_wrong_with_time() -> None:
    totals: dict[str, Value] = {
        "actors/missed_deadlines": 900,
        "actors/late_frames": 99,
        "actors/waits_given_up": 25_300_000,
    }
    (line,) = Recorder().said(changed(STATUS, totals))
    assert " | 3 of 4 actors, 999 late, 25M gave up | " in line


def test_plain_line_every_ten_seconds() -> None:
    recorder = Recorder()
    counts = []
    for now in (0.0, 1.0, 9.9, 10.0, 11.0, 20.5):
        recorder.now = now
        counts.append(len(recorder.said(STATUS)))
    assert counts == [1, 0, 0, 1, 0, 1]


@pytest.mark.parametrize(
    "change", [{"run/epoch": 43}, {"run/phase": "finishing"}, {"play/test_epoch": 42}]
)
def test_plain_line_at_once_when_a_chapter_ends(change: dict[str, Value]) -> None:
    recorder = Recorder()
    recorder.said(STATUS)
    assert len(recorder.said(changed(STATUS, change))) == 1


def test_plain_events_are_said_at_once_in_one_line() -> None:
    recorder = Recorder()
    recorder.display.event("c\nd\x1b[2J")
    assert recorder.stream.getvalue()[9:] == "c d [2J\n"


def test_plain_checks_speak_when_they_change() -> None:
    recorder = Recorder()
    recorder.said(STATUS)
    red = replace(STATUS, checks=checks(0.31))
    assert recorder.said(red) == [
        "HEALTH CHECK RED: valid frames is 0.3100, not >= 0.99: "
        "the screen is not found in the camera's picture"
    ]
    assert recorder.said(red) == []
    assert recorder.said(STATUS) == ["health check green again: valid frames is 0.9994"]


def test_plain_line_on_an_ascii_stream() -> None:
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    PlainDisplay(stream).line("−1 ≥ ü")
    stream.seek(0)
    assert stream.read()[9:] == "-1 >= ?\n"
