"""One process of an evaluation, which tells its games to the process that started it."""

import os
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from actors.games import GamesOptions, games
from common.errors import InputError
from common.run.origin import origin_of
from common.settings.presets import PRESETS
from common.settings.stored_config import to_json
from tests.paths import ROOT

FAST = PRESETS["fast"]

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
    settings = to_json(FAST)
    done = subprocess.run(
        [
            *(sys.executable, "-m", "chatty"),
            *("--weights", "w", "--settings", settings, "--ending", "8", "--epsilon", "0"),
        ],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == '{"score": 1.0}\n'
    assert "loading the game" in done.stderr
    assert "so does C" in done.stderr


def test_who_is_asked_to_end_before_the_last_game_says_that_games_are_missing() -> None:
    stop = threading.Event()
    policy = ROOT / "policies" / "ale_pong.safetensors"
    trained = origin_of(policy)
    assert trained is not None
    config = replace(trained, play=replace(trained.play, max_game_frames=40, random_starts=0))
    options = GamesOptions(policy, "", ending=8, epsilon=0.001, games=2)
    assert len([*games(config, options, stop)]) == 2
    playing = games(config, options, stop)
    next(playing)
    stop.set()
    with pytest.raises(InputError, match=r"^a playing process was asked to end, so games are miss"):
        next(playing)
