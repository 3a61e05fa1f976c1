"""The processes of an evaluation, played by a script: who plays what, and what is said of them."""

import io
import json
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from common.errors import InputError
from common.run.presets import PRESETS
from learner.evaluation import offline
from learner.evaluation.offline import EvaluationOptions, evaluate, play
from tests.patience import PATIENCE

CONFIG = replace(PRESETS["fast"], seed=7)
PLAYS = """
import json, sys
told = dict(zip(sys.argv[3::2], sys.argv[4::2]))
for game in range(int(told["--games"])):
    print(json.dumps({name: told[name] for name in ("--seed", "--steps", "--epsilon")}), flush=True)
"""


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of a program that every child runs instead of Python."""
    file = tmp_path / "program"
    monkeypatch.setattr(sys, "executable", str(file))
    return file


PYTHON = sys.executable


def write(program: Path, script: str) -> None:
    program.write_text(f"#!{PYTHON}\n{script}\n")
    program.chmod(0o755)


def test_games_and_steps_are_shared_out_beforehand_with_seeds_of_their_own(program: Path) -> None:
    write(program, PLAYS)
    options = EvaluationOptions(Path("w"), games=7, test_steps=100, processes=3)
    found = list(play(options, CONFIG, ["--sync", "x"], threading.Event()))
    games = {at: [each for each in found if each["process"] == at] for at in range(3)}
    assert [len(each) for each in games.values()] == [3, 2, 2]
    assert [{each["--seed"] for each in own} for own in games.values()] == [
        {"7000"}, {"7001"}, {"7002"}
    ]  # fmt: skip
    assert {each["--steps"] for each in found} == {"34"}
    assert {each["--epsilon"] for each in found} == {"0.001"}


def test_no_more_processes_than_games(program: Path) -> None:
    write(program, PLAYS)
    options = EvaluationOptions(Path("w"), games=2, processes=9)
    assert len(list(play(options, CONFIG, [], threading.Event()))) == 2


def test_a_process_that_fails_is_quoted(program: Path) -> None:
    write(
        program, "import sys; print('error: weights of 4 actions.', file=sys.stderr); sys.exit(2)"
    )
    options = EvaluationOptions(Path("w"), games=2, processes=2)
    with pytest.raises(InputError, match=r"could not be played: weights of 4 actions\.$"):
        list(play(options, CONFIG, [], threading.Event()))


def test_a_stop_ends_every_process(program: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(program, "import time\nprint('{}', flush=True)\ntime.sleep(10_000)")
    children: list[offline.Child] = []

    started = offline.Child

    def start(*arguments: Any, **streams: Any) -> offline.Child:
        children.append(started(*arguments, **streams))
        return children[-1]

    monkeypatch.setattr(offline, "Child", start)
    stop = threading.Event()
    console = Console(file=io.StringIO())
    options = EvaluationOptions(program, games=2, processes=2)
    result: list[int] = []
    games = threading.Thread(
        target=lambda: result.append(evaluate(options, CONFIG, [], stop, console)), daemon=True
    )
    games.start()
    stop.set()
    games.join(PATIENCE)
    assert result == [130]
    assert [child.poll() for child in children] == [-9, -9]


def test_results_are_printed_and_written(
    program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    game = {
        "score": 3.0, "steps": 50, "matched": 40, "valid": 50, "decisions": 80,
        "missed_deadlines": 4, "late_frames": 7, "key_times": [0] * 120,
    }  # fmt: skip
    write(program, f"print({json.dumps(game)!r}, flush=True)")
    file = tmp_path / "results.json"
    options = EvaluationOptions(program, games=2, processes=2, json=file)
    console = Console(file=io.StringIO(), width=100, record=True)
    assert evaluate(options, CONFIG, ["--sync"], threading.Event(), console) == 0
    told = json.loads(file.read_text())
    assert (told["games"], told["scores"], told["seed"], told["flags"]) == (
        2, [3.0, 3.0], 7, ["--sync"]
    )  # fmt: skip
    assert "interquartile mean" in console.export_text()
