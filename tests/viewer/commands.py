"""Commands of `python -m viewer`, in the process of a test."""

import sys

import pytest

from viewer.__main__ import main


def command(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    """`python -m viewer ARGUMENTS` in this process; signals stay pytest's.

    It prints for a wide page without colours, wherever the tests run.
    """
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    monkeypatch.setattr("viewer.__main__.on_signals", lambda stop: None)
    monkeypatch.setattr(sys, "argv", ["viewer", *arguments])
    return main()
