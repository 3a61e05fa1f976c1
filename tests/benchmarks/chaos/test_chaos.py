"""A whole run under every kind of fault, audited."""

import json
from pathlib import Path

import pytest

from benchmarks.chaos.__main__ import Options, measure
from benchmarks.chaos.faults import FAULTS
from common.errors import InputError


def test_no_kind_of_fault_costs_an_acknowledged_chunk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # By wrong bits in its own messages Zenoh may panic, so that fault is not for every test run.
    monkeypatch.delitem(FAULTS, "one wrong bit in each piece")
    # After each fault all has worked again anyway; to go on for seconds keeps both cores busy.
    monkeypatch.setattr("benchmarks.chaos.__main__._LONGEST", 0.5)
    folder = tmp_path / "run"
    # It ends with the last fault, however slow the machine is.
    report = measure(
        Options(minutes=60, faults=len(FAULTS), seed=5, capacity=40_000, folder=folder)
    )
    struck = report.content["struck"]
    assert sorted(each["fault"] for each in struck) == sorted(FAULTS)
    told = report.content["audit"]
    assert told["acknowledged"] > 5 * len(FAULTS)
    assert told["lost"] == told["duplicated"] == told["unknown_rows"] == 0
    # The programs' own count says the same as the witnesses.
    summary = json.loads((folder / "runs/chaos/summary.json").read_text())
    assert summary["agent_steps"] == told["steps"]


def test_a_folder_with_something_in_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "old").touch()
    with pytest.raises(InputError, match="holds something already"):
        measure(Options(folder=tmp_path))
