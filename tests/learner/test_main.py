"""What the learner's program says last, and its exit code."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from common.run.folder import RunFolder
from learner.process import _last_words

ARGUMENTS = ["learner", "--local", "--run", "small"]


def ended(failed: str | None) -> Any:
    """A learner that has ended before its goal; ``failed`` says why its health guard did so."""
    return SimpleNamespace(failed=failed, phases=SimpleNamespace(done=False))


def test_a_run_that_its_guard_ended_has_exit_code_3_and_says_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ARGUMENTS)
    assert _last_words(ended("no screen is seen"), RunFolder(tmp_path, "small")) == 3
    told = capsys.readouterr()
    assert told.out == ""
    assert f"stopped: no screen is seen. Everything is in {tmp_path / 'small'}" in told.err
    assert "python -m learner --local --run small --resume --force" in told.err


def test_a_run_that_was_asked_to_end_has_exit_code_0(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ARGUMENTS)
    assert _last_words(ended(None), RunFolder(tmp_path, "small")) == 0
    told = capsys.readouterr()
    assert told.err == ""
    assert told.out.endswith("go on with:\n  python -m learner --local --run small --resume\n")
