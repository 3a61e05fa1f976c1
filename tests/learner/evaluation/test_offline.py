"""The processes of an evaluation, played by a script: who plays what, and what is said of them."""

import errno
import gc
import hashlib
import io
import json
import os
import sys
import threading
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from common.errors import InputError
from common.exit_codes import FAILED
from common.process.supervisor import Child
from common.registry import ENVIRONMENTS, Environment
from common.settings.clock import ClockConfig
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from common.settings.ranges import all_ranges
from learner.evaluation import offline
from learner.evaluation.offline import evaluate, play
from learner.evaluation.options import EvaluationOptions
from tests.extending.whole_run import added
from tests.patience import PATIENCE

CONFIG = replace(PRESETS["fast"], seed=7)
PLAYS = """
import json, sys
told = dict(zip(sys.argv[3::2], sys.argv[4::2]))
for game in range(int(told["--games"])):
    seen = {name: told[name] for name in ("--seed", "--steps", "--epsilon")}
    print(json.dumps({**seen, "steps": 50}), flush=True)
"""


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of a program that every child runs instead of Python."""
    file = tmp_path / "program"
    monkeypatch.setattr(sys, "executable", str(file))
    # It plays without a network.
    monkeypatch.setattr("learner.evaluation.offline.load_network_file", lambda *_: None)
    monkeypatch.setattr("learner.evaluation.offline.origin_of", lambda _: None)
    return file


PYTHON = sys.executable


def write(program: Path, script: str) -> None:
    program.write_text(f"#!{PYTHON}\n{script}\n")
    program.chmod(0o755)


def test_games_and_steps_are_shared_out_beforehand_with_seeds_of_their_own(program: Path) -> None:
    write(program, PLAYS)
    options = EvaluationOptions(games=7, test_steps=100, processes=3)
    found = list(play(Path("w"), options, 0.25, CONFIG, ["--sync", "x"], threading.Event()))
    games = {at: [each for each in found if each["process"] == at] for at in range(3)}
    assert [len(each) for each in games.values()] == [3, 2, 2]
    assert [{each["--seed"] for each in own} for own in games.values()] == [
        {"7000"}, {"7001"}, {"7002"}
    ]  # fmt: skip
    assert {each["--steps"] for each in found} == {"34"}
    assert {each["--epsilon"] for each in found} == {"0.25"}


def test_no_more_processes_than_games(program: Path) -> None:
    write(program, PLAYS)
    options = EvaluationOptions(games=2, processes=9)
    assert len(list(play(Path("w"), options, 0.25, CONFIG, [], threading.Event()))) == 2


@pytest.mark.parametrize("starts", [1, 2])
def test_an_evaluation_leaves_no_process_and_no_pipe(
    program: Path, monkeypatch: pytest.MonkeyPatch, starts: int
) -> None:
    """Also where the second process cannot be started."""
    write(program, "import sys; sys.stdin.read()" if starts == 1 else PLAYS)
    children: list[Child] = []

    def start(*arguments: Any, **streams: Any) -> Child:
        if len(children) == starts:
            raise OSError("no memory")
        children.append(Child(*arguments, **streams))
        return children[-1]

    monkeypatch.setattr(offline, "Child", start)
    gc.collect()  # what earlier tests left behind would be closed meanwhile
    before = set(os.listdir("/proc/self/fd"))
    options = EvaluationOptions(games=2, processes=2)
    with nullcontext() if starts == 2 else pytest.raises(OSError, match="no memory"):
        list(play(Path("w"), options, 0.25, CONFIG, [], threading.Event()))
    for child in children:
        assert child.returncode is not None
        child._reader.join(PATIENCE)
    assert set(os.listdir("/proc/self/fd")) == before


def test_a_process_that_fails_is_quoted(program: Path) -> None:
    write(
        program, "import sys; print('error: weights of 4 actions.', file=sys.stderr); sys.exit(5)"
    )
    options = EvaluationOptions(games=2, processes=2)
    with pytest.raises(InputError, match=r"played: weights of 4 actions\.$") as error:
        list(play(Path("w"), options, 0.25, CONFIG, [], threading.Event()))
    assert error.value.exit_code == 5


def test_a_process_that_is_killed_is_told(program: Path) -> None:
    write(program, "import os; os.kill(os.getpid(), 9)")
    options = EvaluationOptions(games=2, processes=2)
    with pytest.raises(InputError, match=r"played: signal 9 ended a process\.$") as error:
        list(play(Path("w"), options, 0.25, CONFIG, [], threading.Event()))
    assert error.value.exit_code == FAILED


def test_a_process_that_writes_much_to_its_standard_error_plays_on(program: Path) -> None:
    write(program, f"import sys\nsys.stderr.write(200_000 * 'warning\\n'){PLAYS}")
    options = EvaluationOptions(games=4, processes=2)
    found: list[Any] = []
    playing = threading.Thread(
        target=lambda: found.extend(play(Path("w"), options, 0.25, CONFIG, [], threading.Event())),
        daemon=True,
    )
    playing.start()
    playing.join(PATIENCE)
    assert len(found) == 4


def test_a_stop_ends_every_process(
    program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(program, "import time\nprint('{}', flush=True)\ntime.sleep(10_000)")
    children: list[Child] = []

    def start(*arguments: Any, **streams: Any) -> Child:
        children.append(Child(*arguments, **streams))
        return children[-1]

    monkeypatch.setattr(offline, "Child", start)
    stop = threading.Event()
    said = io.StringIO()
    console = Console(file=said)
    gone = "learner.evaluation.offline.Progress.__exit__"
    monkeypatch.setattr(gone, lambda *_: said.write("the bar has gone\n"))
    file = tmp_path / "results.json"
    options = EvaluationOptions(games=2, processes=2, json=file)
    result: list[Any] = []
    games = threading.Thread(
        target=lambda: result.append(
            evaluate(program, options, CONFIG, ClockConfig(), stop, console)
        ),
        daemon=True,
    )
    games.start()
    stop.set()
    games.join(PATIENCE)
    assert result == [None]
    assert f"the bar has gone\nstopped after 0 games: {file} is not written\n" in said.getvalue()
    assert [child.poll() for child in children] == [-9, -9]


GAME = {
    "score": 3.0, "steps": 50, "matched": 40, "valid": 50, "follows": 50, "decisions": 80,
    "missed_deadlines": 4, "late_frames": 7, "key_times": [0] * 119 + [1], "game_seconds": 5.3,
    "wall_seconds": 2.0, "game_hash": "1", "ending_hash": "2",
}  # fmt: skip
TELLS_ITS_CHANCES = f"""
import json, sys
told = dict(zip(sys.argv[3::2], sys.argv[4::2]))
sticky = json.loads(told["--settings"])["play"]["sticky"]
epsilon = float(told["--epsilon"])
for game in range(int(told["--games"])):
    print(json.dumps({{**{GAME!r}, "score": 1_000 * epsilon + 100 * sticky}}), flush=True)
"""


def evaluated(
    network: Path, options: EvaluationOptions, config: RunConfig, trained: RunConfig | None
) -> Any:
    """What an evaluation returns, and what it shows."""
    console = Console(file=io.StringIO(), width=120, record=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(offline, "origin_of", lambda _: trained)
        found = evaluate(network, options, config, ClockConfig(), threading.Event(), console)
    return found, console.export_text()


def test_a_stop_shows_the_measures_whose_games_are_all_there(
    program: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(program, TELLS_ITS_CHANCES)
    stop = threading.Event()
    played = offline.play

    def stopping(*told: Any) -> Any:
        for number, game in enumerate(played(*told), 1):
            if number == 2:
                stop.set()  # with the last game of the first measure
            yield game

    monkeypatch.setattr("learner.evaluation.offline.play", stopping)
    console = Console(file=io.StringIO(), width=120, record=True)
    options = EvaluationOptions(games=2, headline=True)
    assert evaluate(program, options, CONFIG, ClockConfig(), stop, console) is None
    *shown, said = console.export_text().splitlines()
    assert any("1.00 ± 0.00" in line for line in shown)
    assert said == "stopped after 2 games"


@pytest.mark.parametrize(("steps", "whole"), [(300, True), (301, False)])
def test_a_stop_before_all_test_steps_is_one_even_if_there_are_games_enough(
    steps: int, whole: bool, program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Games that end first are defeats. Two processes have to play half of the steps each."""
    write(
        program,
        f"import sys, time\nfor game in range(3): print({json.dumps(GAME)!r}, flush=True)\n"
        "if int(sys.argv[sys.argv.index('--steps') + 1]) > 150: time.sleep(600)\n",
    )
    stop = threading.Event()
    played = offline.play

    def stopping(*told: Any) -> Any:
        for number, game in enumerate(played(*told), 1):
            if number == 6:
                stop.set()
            yield game

    monkeypatch.setattr("learner.evaluation.offline.play", stopping)
    console = Console(file=io.StringIO(), width=120, record=True)
    file = tmp_path / "games.json"
    options = EvaluationOptions(games=2, processes=2, test_steps=steps, json=file)
    found = evaluate(program, options, CONFIG, ClockConfig(), stop, console)
    assert (found is not None, file.exists()) == (whole, whole)
    assert (found is None) == ("stopped after 6 games" in console.export_text())


def test_a_stop_tells_the_scores_of_a_measure_that_is_not_whole(
    program: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(program, TELLS_ITS_CHANCES)
    stop = threading.Event()

    def stopping(*_: Any) -> Any:
        yield {"score": 3.0}
        yield {"score": -21.0}
        stop.set()
        raise offline.Stopped

    monkeypatch.setattr("learner.evaluation.offline.play", stopping)
    console = Console(file=io.StringIO(), width=120, record=True)
    assert evaluate(program, EvaluationOptions(), CONFIG, ClockConfig(), stop, console) is None
    assert console.export_text().endswith("\nstopped after 2 games (3, −21)\n")


def test_scores_are_in_the_order_of_processes_and_not_of_ends(
    program: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended = [(1, 5.0), (0, 1.0), (1, 6.0), (0, 2.0), (2, 9.0)]
    games = [GAME | {"process": process, "score": score} for process, score in ended]
    monkeypatch.setattr("learner.evaluation.offline.play", lambda *_: iter(games))
    write(program, "")
    content, _ = evaluated(program, EvaluationOptions(games=5, processes=3), CONFIG, None)
    assert content["scores"] == [1.0, 2.0, 5.0, 6.0, 9.0]


@pytest.mark.parametrize("valid", [49, 50])
def test_a_score_of_a_robot_that_did_not_see_is_told_as_such(program: Path, valid: int) -> None:
    write(program, f"print({json.dumps(GAME | {'valid': valid})!r}, flush=True)")
    _, shown = evaluated(program, EvaluationOptions(games=2, processes=2), CONFIG, None)
    told = "The screen was found in 98.0 % of the frames only: what was not seen cannot be played."
    assert (told in shown) == (valid < 50)
    assert "did not change as the game did" not in shown


@pytest.mark.parametrize("follows", [24, 25])
def test_a_score_of_a_camera_that_stopped_is_told_as_such(program: Path, follows: int) -> None:
    write(program, f"print({json.dumps(GAME | {'follows': follows})!r}, flush=True)")
    found, shown = evaluated(program, EvaluationOptions(games=2, processes=2), CONFIG, None)
    assert found["following_frame_share"] == follows / 50
    assert ("The frames mostly did not change as the game did" in shown) == (follows < 25)


def test_results_are_printed_and_written(
    program: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("common.process.progress.PLAIN_SECONDS", 0.0)
    write(program, f"print({json.dumps(GAME)!r}, flush=True)")
    file = tmp_path / f"{'results' * 20}[seed=1].json"
    options = EvaluationOptions(games=2, processes=2, json=file)
    found, shown = evaluated(program, options, CONFIG, None)
    told = json.loads(file.read_text())
    assert told == found
    assert (told["games"], told["scores"], told["seed"], told["flags"]) == (
        2, [3.0, 3.0], 7, ["--sync"]
    )  # fmt: skip
    assert (told["epsilon"], told["sticky"], told["changed"]) == (0.001, 0.0, [])
    assert told["press_ms"]["p50"] is None  # JSON has no infinity
    assert told["versions"]["python"]
    assert told["sha256"] == hashlib.sha256(program.read_bytes()).hexdigest()
    assert "interquartile mean" in shown
    assert shown.endswith(f"\nwrote {file}\n")
    # Without a terminal there are lines instead of a bar.
    first, *later = capsys.readouterr().err.splitlines()
    assert first.endswith("2 games, 2 at a time; the time left follows with the first")
    assert "evaluating: 50 %, 1 of 2 games" in later[0]
    assert shown.splitlines()[:2] == ["game 1: score 3", "game 2: score 3"]


def test_on_a_full_disk_the_file_is_named(
    program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    write(program, f"print({json.dumps(GAME)!r}, flush=True)")
    monkeypatch.setattr("learner.evaluation.offline.write_json", refuse)
    options = EvaluationOptions(games=1, json=tmp_path / "f.json")
    with pytest.raises(InputError, match=r"f\.json cannot be written \(No space .*: name another"):
        evaluated(program, options, CONFIG, None)


def test_settings_other_than_the_networks_are_told(program: Path) -> None:
    write(program, TELLS_ITS_CHANCES)
    options = EvaluationOptions(games=2, epsilon=0.05)
    trained = replace(CONFIG, seed=1, play=replace(CONFIG.play, sticky=0.5))
    found, shown = evaluated(
        program, options, replace(trained, game="space_invaders", seed=3), trained
    )
    assert found["changed"] == ["game pong → space_invaders"]
    assert found["conditions"] == ["play.sticky 0.0 → 0.5"]
    assert (found["epsilon"], found["sticky"], found["mean"]) == (0.05, 0.5, 100.0)
    assert "100.00 ± 0.00" in shown


def test_a_headline_is_three_measures_in_one_table_and_one_file(
    program: Path, tmp_path: Path
) -> None:
    write(program, TELLS_ITS_CHANCES)
    file = tmp_path / "headline.json"
    options = EvaluationOptions(headline=True, games=3, processes=2, json=file)
    trained = replace(CONFIG, play=replace(CONFIG.play, sticky=0.1))
    found, shown = evaluated(program, options, trained, trained)
    assert json.loads(file.read_text()) == found
    # 1000 ε + 100 p: what really played is what the row says.
    assert [(row["epsilon"], row["sticky"], row["mean"]) for row in found["rows"]] == [
        (0.001, 0.0, 1.0), (0.05, 0.0, 50.0), (0.001, 0.25, 26.0)
    ]  # fmt: skip
    assert [row["changed"] for row in found["rows"]] == [
        ["play.sticky 0.1 → 0.0"], ["play.sticky 0.1 → 0.0"], ["play.sticky 0.1 → 0.25"]
    ]  # fmt: skip
    assert {row["games"] for row in found["rows"]} == {3}
    assert (found["weights"], found["seed"], found["flags"]) == (str(program), 7, ["--sync"])
    assert found["versions"]["python"]
    for cell in (
        "not in real time",
        "1.00 ± 0.00",
        "50.00 ± 0.00",
        "26.00 ± 0.00",
    ):
        assert cell in shown


def test_a_headline_has_no_sticky_actions_where_no_console_could_repeat_them() -> None:
    options = EvaluationOptions(headline=True)
    for atari, sticky in ((False, [0.0, 0.0]), (True, [0.0, 0.0, 0.25])):
        with added(ENVIRONMENTS, Environment("lamps", "lamps:make", lambda _: 3, atari=atari)):
            measures = options.measures(replace(CONFIG, env="lamps"), None)
        assert [each.sticky for each in measures] == sticky


def test_what_a_headline_would_override_is_refused(program: Path) -> None:
    write(program, TELLS_ITS_CHANCES)
    with pytest.raises(InputError, match="omit --epsilon"):
        EvaluationOptions(headline=True, epsilon=0.001).check()
    for trained in (CONFIG, None):
        sticky = replace(CONFIG, play=replace(CONFIG.play, sticky=0.1))
        with pytest.raises(InputError, match=r"omit --play\.sticky"):
            evaluated(program, EvaluationOptions(headline=True), sticky, trained)
    drawn = replace(CONFIG, randomise=all_ranges("ale"))
    with pytest.raises(InputError, match=r"give --randomise\.sticky 0"):
        evaluated(program, EvaluationOptions(headline=True), drawn, CONFIG)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (EvaluationOptions(games=0), "--games is 0: choose 1 or more"),
        (EvaluationOptions(games=10**7), "--games is 10000000: choose at most 1000000"),
        (EvaluationOptions(test_steps=-1), "--test-steps is -1: choose 0 or more"),
        (EvaluationOptions(processes=-1), "--processes is -1: choose 0 or more"),
        (EvaluationOptions(epsilon=1.5), "--epsilon is 1.5: choose at most 1"),
    ],
)
def test_options_out_of_bounds_are_refused(options: EvaluationOptions, words: str) -> None:
    with pytest.raises(InputError, match=words):
        options.check()
