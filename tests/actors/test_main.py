"""The command line of `python -m actors`."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from actors.__main__ import ActorOptions, viewer_command
from common.errors import InputError
from common.process.command_line import parse
from tests.paths import ROOT


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        ("--sync --envs 2", ""),
        ("--check -o p.png", "check -o p.png"),
        ("--env ale --play --games 2", "play --env ale --games 2"),
        ("--human", "human"),
        ("--sync --human --game breakout", "human --game breakout"),
        ("--viewer rerun", "play --viewer rerun"),
        ("--viewer=rerun --play", "play --viewer=rerun"),
    ],
)
def test_former_flags_of_the_viewer(arguments: str, meant: str) -> None:
    assert viewer_command(arguments.split()) == meant.split()


def test_a_former_flag_starts_the_viewer(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "actors", "--check", "--env", "ale", "-o", tmp_path / "check.png"],
        cwd=ROOT,
        env={**os.environ, "COLUMNS": "120"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "pong (ale), 200 random agent steps" in done.stdout
    assert (tmp_path / "check.png").is_file()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("--envs 0", "--envs is 0: choose 1 or more"),
        ("--envs 257", "--envs is 257: choose at most 256"),
        ("--seed -1", "--seed is -1: choose 0 or more"),
        ("--evaluator --envs 2", "omit --envs"),
        ("--speed 2", "--speed is for --no-sync"),
    ],
)
def test_options_that_cannot_be_followed(arguments: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        parse(ActorOptions, "actors", arguments.split()).check()
