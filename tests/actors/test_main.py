"""The command line of `python -m actors`."""

import socket

import pytest

from actors.options import ActorOptions
from actors.process import _default_name
from common.command_line.parser import parse
from common.errors import InputError
from common.protocol.run_keys import check_name


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("--envs 0", "--envs is 0: choose 1 or more"),
        ("--envs 257", "--envs is 257: choose at most 256"),
        ("--seed -1", "--seed is -1: choose 0 or more"),
        ("--evaluator --envs 2", "omit --envs"),
        ("--no-sync --envs 2", "--no-sync needs an actor for each environment: omit --envs"),
        ("--speed 2", "--speed is for --no-sync"),
        ("--check -o p.png", "--check is a command of its own: call `ale-robot check`"),
        ("--viewer=rerun", "--viewer is for `ale-robot play`: call that"),
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
