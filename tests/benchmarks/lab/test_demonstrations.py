"""`benchmarks.lab.demonstrations`: pairs of runs, and what they tell."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.lab import demonstrations
from common.errors import InputError
from common.run.epochs import EpochTable
from common.run.folder import RunFolder
from tests.epoch_rows import epoch_row

SCORES = {"without": (-20.0, 3.0, 18.0), "with": (-3.0, 19.0, 17.0)}


def train(folder: RunFolder, steps: int, flags: Sequence[str]) -> dict[str, Any]:
    """A training that only leaves its tables; the recorded steps are 300 of the warm-up's 1,000."""
    how = "with" if "--demonstrations" in flags else "without"
    assert f"-{how}-" in folder.name
    assert not folder.path.exists()
    folder.path.mkdir(parents=True)
    table = EpochTable(folder.epochs)
    for epoch, score in enumerate(SCORES[how], 1):
        row = epoch_row([score], epoch=epoch, phase="test", total_train_steps=epoch * 500)
        table.append(replace(row, total_time=60.0 * epoch))
    summary: dict[str, Any] = {
        "agent_steps": steps,
        "demonstrations": 300 if how == "with" else 0,
        "config": {"replay": {"learning_starts": 1_000}},
    }
    folder.summary.write_text(json.dumps(summary))
    return summary


def test_steps_of_their_own_are_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demonstrations, "train", train)
    options = demonstrations.Options(
        recording=tmp_path / "d", score=18.0, steps=5_000, seeds=2, runs=tmp_path / "runs"
    )
    for _ in range(2):  # the same command again trains nothing
        report = demonstrations.measure(options)
        assert [row["own steps"] for row in report.content["rows"]] == [2_500, 1_700] * 2
        assert [row["best test"] for row in report.content["rows"]] == [18.0, 19.0] * 2
        assert report.content["saved"] == [800, 800]
        assert report.notes == ("saved agent steps: 800, 800; recorded: 300",)
    never = demonstrations.measure(replace(options, score=18.5))
    assert never.content["saved"] == [None, None]
    assert never.notes == ("in no pair did both runs reach the score",)
    other = replace(options, learner="--env ale")
    with pytest.raises(
        InputError,
        match=r"without-seed-1/asked\.json is damaged or of another comparison: name another",
    ):
        demonstrations.measure(other)
    (tmp_path / "runs" / "demonstrations-without-seed-1" / "asked.json").write_text('{"flags": [')
    with pytest.raises(InputError, match=r"without-seed-1/asked\.json is damaged or of another"):
        demonstrations.measure(options)
