"""Commands of `python -m viewer`, in the process of a test."""

import sys
from typing import TypeVar

import pytest

from common.command_line.played import Played, parse_played
from viewer.__main__ import main

P = TypeVar("P", bound=Played)


def parsed(kind: type[P], *arguments: object) -> P:
    """The command ``kind`` with these arguments, under the settings of the network it names."""
    return parse_played(kind, "viewer", list(map(str, arguments)))


def command(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    """`python -m viewer ARGUMENTS` in this process; signals stay pytest's.

    It prints for a wide page without colours, wherever the tests run.
    """
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    monkeypatch.setattr("viewer.__main__.on_signals", lambda stop: None)
    monkeypatch.setattr(sys, "argv", ["viewer", *arguments])
    return main()
