"""What the files of benchmarks hold."""

import json
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from benchmarks.report import BenchmarkOptions, Report, measure_missing, run, with_time_left
from learner.telemetry import provenance as provenance_module
from learner.telemetry.provenance import provenance


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Measure two parts."""


def test_a_result_names_the_commit_at_which_its_program_began(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    commit = "before"
    monkeypatch.setattr(provenance_module, "git_state", lambda _: (commit, False))
    provenance.cache_clear()
    file = tmp_path / "results.json"
    written = []

    def measure(options: Options) -> Report:
        nonlocal commit
        commit = "meanwhile"

        def part(number: int) -> dict[str, int]:
            written.append(file.exists() and json.loads(file.read_bytes())["git_commit"])
            return {"result": number}

        asked = [{"number": 1}, {"number": 2}]
        parts = measure_missing(options.json, {}, "parts", asked, part)
        return Report.of("two parts", parts, {})

    try:
        run("two", Options, measure, ["--json", str(file)])
    finally:
        provenance.cache_clear()
    assert written == [False, "before"]
    assert json.loads(file.read_bytes())["git_commit"] == "before"


def test_the_time_left_counts_how_long_each_part_takes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    for _ in with_time_left([1, 1, 18], "{} games".format, float):
        now[0] += 60.0
    assert capsys.readouterr().out.splitlines() == [
        "1 of 3: 1 games",
        "2 of 3, about 19 min left: 1 games",
        "3 of 3, about 18 min left: 18 games",
    ]
