"""One process of an evaluation, which tells its games to the process that started it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from common.run.presets import PRESETS
from common.run.stored_config import to_json

CHATTY = """
import os, sys
from actors import games

def played(*_):
    print("loading the game")
    os.write(1, b"so does C")
    yield {"score": 1.0}

games.games = played
sys.exit(games.main())
"""


@pytest.mark.usefixtures("forks")
def test_what_an_environment_prints_is_not_taken_for_a_game(tmp_path: Path) -> None:
    (tmp_path / "chatty.py").write_text(CHATTY)
    settings = to_json(PRESETS["fast"])
    done = subprocess.run(
        [
            *(sys.executable, "-m", "chatty"),
            *("--weights", "w", "--settings", settings, "--ending", "8"),
        ],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == '{"score": 1.0}\n'
    assert "loading the game" in done.stderr
    assert "so does C" in done.stderr
