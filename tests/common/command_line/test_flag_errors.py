"""Errors about flags: one sentence with what to do, whatever tyro says."""

import os
import pty
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import pytest
import tyro

from common.command_line.flag_errors import naming_flags
from common.command_line.parser import parse
from common.errors import InputError
from tests.common.command_line.test_parser import parsed
from tests.paths import ROOT


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--gmae", "pong"], r"^there is no flag --gmae: did you mean --game\?$"),
        (
            ["--zzz", "1", "--learning.rate", "2", "--learning.batch", "64"],
            r"^there is no flag --zzz: `python -m program --help` lists the flags\.$",
        ),
        (
            ["--learning.batch", "64", "--gmae", "pong", "--learning.momentum", "0.9"],
            r"^there is no flag --learning.batch: did you mean --learning.batch-size\?$",
        ),
        (["--zzz=1"], r"^there is no flag --zzz.*: `python -m program --help` lists the flags\.$"),
        (["pong"], r"^pong lacks a flag before it, or is one too many: `python -m program "),
        *(
            ([flag], rf"^{flag} needs a value: `python -m program --help` explains the flags\.$")
            for flag in ("--seed", "--preset", "--env")
        ),
        (["--seed", "two"], r"^--seed is 'two': give a whole number; `python -m program --help` "),
        (["--seed", "400,000"], r"^--seed is '400,000': write it without commas; `python "),
        (["--seed", "4,00"], r"^--seed is '4,00': give a whole number; `python "),
        (["--learning.discount", "x"], r"^--learning.discount is 'x': give a number; `python "),
        (
            ["--learning.target", "triple"],
            r"^--learning.target is 'triple': choose one of 'dqn', 'double'; `python -m program ",
        ),
    ],
)
def test_what_is_not_understood_is_told_in_a_sentence(arguments: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        parsed(*arguments)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--zzz=1"], r"`ale-robot train --help-all` lists the flags\.$"),
        (["--seed"], r"`ale-robot train --help-all` explains the flags\.$"),
    ],
)
def test_a_command_names_its_help_with_every_flag(
    arguments: list[str], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["ale-robot train"])
    with pytest.raises(InputError, match=words):
        parsed(*arguments)


@dataclass(frozen=True)
class Demanding:
    """What cannot do without."""

    source: tyro.conf.Positional[Path]
    """Where it comes from."""
    target: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Where it goes, which is a long story that does not fit a line of the box in which tyro tells
    it."""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], r"^PATH is missing \(Where it comes from\): `python -m program --help` explains"),
        (["a"], r"^-o PATH, --target PATH is missing \(Where it goes, which .* tyro tells it\): `"),
    ],
)
def test_what_is_missing_is_told_with_its_meaning(arguments: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        parse(Demanding, "program", arguments)


@dataclass(frozen=True)
class Choosing:
    """What must be told which."""

    engine: tyro.conf.Positional[Literal["one", "two"]]
    """Engine that runs it."""
    steps: int | None = None
    """Number of steps."""


@dataclass(frozen=True)
class Named:
    """What must be told who."""

    name: tyro.conf.Positional[str]
    """OWNER/NAME at the hub."""


@pytest.mark.parametrize(
    ("kind", "arguments", "words"),
    [
        (Choosing, [], r"^name one of one, two \(Engine that runs it\): `python -m program "),
        (Choosing, ["one", "--steps", "x"], r"^--steps is 'x': give a whole number; `python -m "),
        (Named, [], r"^a name is missing \(OWNER/NAME at the hub\): `python -m program --help` "),
    ],
)
def test_a_missing_choice_or_name_is_told(kind: type, arguments: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        parse(kind, "program", arguments)


def test_settings_in_an_error_are_written_as_flags() -> None:
    with pytest.raises(InputError) as told, naming_flags():
        raise InputError(
            "replay.capacity is 5, but my.replay.capacity and ./play.hand are files: raise "
            "replay.learning_starts, or play.vector",
            exit_code=75,
        )
    assert str(told.value) == (
        "--replay.capacity is 5, but my.replay.capacity and ./play.hand are files: raise "
        "--replay.learning-starts, or --play.vector"
    )
    assert told.value.exit_code == 75
    with pytest.raises(InputError) as told, naming_flags():
        raise InputError("seed is -1: the seed is what a game begins with")
    assert str(told.value) == "--seed is -1: the seed is what a game begins with"


@pytest.mark.parametrize("text", ["learning.n_steps: unknown", "camera.yawx is bad"])
def test_a_name_that_only_begins_like_a_setting_stays(text: str) -> None:
    with pytest.raises(InputError) as told, naming_flags():
        raise InputError(text)
    assert str(told.value) == text


@pytest.mark.usefixtures("forks")
def test_in_a_terminal_an_error_is_the_same_sentence() -> None:
    """Where tyro would colour its box."""
    here, there = pty.openpty()
    with os.fdopen(here, "rb", buffering=0) as screen:
        done = subprocess.run(
            [sys.executable, "-m", "learner", "--preest", "fast"],
            cwd=ROOT,
            env={**os.environ, "TERM": "xterm-256color"},
            stdin=there,
            stdout=there,
            stderr=there,
            check=False,
        )
        os.close(there)
        told = b""
        with suppress(OSError):  # the end of a terminal's output
            while part := screen.read(4096):
                told += part
    assert done.returncode == 2
    assert told == b"error: there is no flag --preest: did you mean --preset?\r\n"
