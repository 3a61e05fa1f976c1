"""The command line of `python -m actors`."""

import os
import socket
import sys
from pathlib import Path

import pytest

from actors.__main__ import main, viewer_command
from actors.options import ActorOptions
from actors.process import _default_name
from common.errors import InputError
from common.process.command_line import parse
from common.protocol.run_keys import check_name
from viewer import __main__ as viewer
from viewer.check import Check


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
        ("--play --weights w.safetensors --games 2", "play w.safetensors --games 2"),
        ("--play --weights=w.safetensors", "play w.safetensors"),
        ("--play --weights", "play --weights"),
        ("--weights --play", "play --weights"),
        ("--play --weights --seed 3", "play --weights --seed 3"),
    ],
)
def test_former_flags_of_the_viewer(arguments: str, meant: str) -> None:
    assert viewer_command(arguments.split()) == meant.split()


def test_a_former_flag_starts_the_viewer(monkeypatch: pytest.MonkeyPatch) -> None:
    class Replaced(Exception):
        """This process is another program from here on."""

    def become(program: str, arguments: list[str]) -> None:
        assert (program, arguments[:3]) == (sys.executable, [sys.executable, "-m", "viewer"])
        assert parse(viewer.EVERY, "viewer", arguments[3:]) == Check(env="ale", output=Path("p"))
        raise Replaced

    monkeypatch.setattr(sys, "argv", ["actors", "--check", "--env", "ale", "-o", "p"])
    monkeypatch.setattr(os, "execv", become)
    with pytest.raises(Replaced):
        main()


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


@pytest.mark.parametrize("host", ["robot-1.example.org", "ロボット", "-", ""])
def test_an_actor_is_called_after_its_machine_whatever_that_is_called(
    host: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(socket, "gethostname", lambda: host)
    name = check_name("actor", _default_name())
    assert name.startswith("robot-1-" if host.startswith("robot") else "actor-")
