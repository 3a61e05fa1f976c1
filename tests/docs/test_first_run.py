"""The notebook is valid, its game is an environment, and (slow) its cells do what they promise."""

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from benchmarks.child import free_endpoint
from tests.paths import ROOT

NOTEBOOK = json.loads((ROOT / "docs" / "first_run.ipynb").read_text(encoding="utf-8"))
ADDRESS = "tcp/127.0.0.1:7457"
CELLS = ["".join(cell["source"]) for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]


def test_it_is_a_notebook_without_outputs() -> None:
    assert NOTEBOOK["nbformat"] == 4
    assert all(not cell.get("outputs") for cell in NOTEBOOK["cells"])
    for cell in CELLS:
        ast.parse(cell)


def test_its_game_is_an_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    cells: dict[str, object] = {}
    exec(CELLS[0], cells)
    game: dict[str, object] = {}
    exec((tmp_path / "first_run" / "catch_game.py").read_text(), game)
    env = game["Catch"]()  # type: ignore[operator]
    assert isinstance(env, gymnasium.Env)
    frames, _ = env.reset(seed=1)
    ball, paddle = int(frames[-1, 0].argmax()) // 12, int(frames[-1, 83].argmax()) // 12
    rewards = []
    over = False
    while not over:
        action = 1 + (ball > paddle) if ball != paddle else 0
        paddle += (0, -1, 1)[action]
        frames, reward, over, _, info = env.step(action)
        assert frames in env.observation_space
        rewards.append(reward)
    assert rewards == [0.0] * 5 + [1.0]
    assert (info["game_score"], info["game_steps"]) == (1.0, 6)
    assert np.count_nonzero(frames[-1] == 160) == 144  # the paddle hides the ball that it caught


@pytest.mark.slow
def test_it_learns_and_shows_it(tmp_path: Path) -> None:
    shown = tmp_path / "IPython"
    shown.mkdir()
    (shown / "__init__.py").touch()
    (shown / "display.py").write_text("Image = str\ndisplay = print\n")
    script = tmp_path / "cells.py"
    code = "\n".join(CELLS)
    assert ADDRESS in code
    script.write_text(code.replace(ADDRESS, free_endpoint()), encoding="utf-8")
    path = os.pathsep.join((str(ROOT), str(tmp_path)))
    done = subprocess.run(
        [sys.executable, script],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=True,
    )
    caught = int(done.stdout.partition("caught ")[2].split()[0])
    assert caught >= 6  # of 10; random play catches a seventh, and so many once in 900 tries
    for name in ("curve.png", "catch.gif", "robot.gif"):
        assert (tmp_path / "first_run" / name).stat().st_size > 5_000
