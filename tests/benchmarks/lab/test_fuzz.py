"""It reports what the fuzzer says of each kind, resumes, and stops when a message does harm."""

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from benchmarks.lab import fuzz
from common.errors import InputError

_SAID = """\
#9849	REDUCE cov: 59 ft: 67 corp: 12/3244b lim: 5014 exec/s: 492 rss: 307Mb L: 74/459
#10000	DONE   cov: 61 ft: 67 corp: 13/3244b lim: 5014 exec/s: 500 rss: 307Mb
Done 10000 runs in 20 second(s)
stat::number_of_executed_units: 10000
stat::average_exec_per_sec:     500
stat::new_units_added:          110
stat::slowest_unit_time_sec:    2
stat::peak_rss_mb:              307
"""


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Kinds that were fuzzed; `harmed` ends in a crash, the others as libFuzzer's runs end."""
    found: list[str] = []

    def run(command: Sequence[str], **_: Any) -> subprocess.CompletedProcess[str]:
        kind = next(iter(command[3:]), "")
        if not kind:
            return subprocess.CompletedProcess(command, 0, "ack\nstats\nharmed\n", "")
        found.append(kind)
        harmed = kind == "harmed"
        return subprocess.CompletedProcess(command, 77 * harmed, "", "crash-1" if harmed else _SAID)

    monkeypatch.setitem(sys.modules, "atheris", object())
    monkeypatch.setattr(fuzz, "subprocess", SimpleNamespace(run=run))
    return found


def test_all_kinds_are_told_and_none_is_fuzzed_again(asked: list[str], tmp_path: Path) -> None:
    file = tmp_path / "fuzz.json"
    fuzz.measure(fuzz.Options(messages=10_000, kinds=("stats",), json=file))
    assert json.loads(file.read_text())["rows"] == [
        {
            "kind": "stats",
            "messages": 10_000,
            "edges reached": 61,
            "kept": 13,
            "longest s": 2,
            "memory MiB": 307,
        }
    ]
    report = fuzz.measure(fuzz.Options(messages=10_000, kinds=("ack", "stats"), json=file))
    assert [row["kind"] for row in report.tables[0].rows] == ["stats", "ack"]
    assert asked == ["stats", "ack"]


def test_harm_is_told_with_the_fuzzers_last_words(asked: list[str]) -> None:
    with pytest.raises(InputError, match=r"harmed .* did harm: crash-1"):
        fuzz.measure(fuzz.Options(kinds=("harmed",)))
    assert asked == ["harmed"]


def test_an_unknown_kind_is_refused(asked: list[str]) -> None:
    with pytest.raises(InputError, match=r"no kind nothing: choose one of ack, stats, harmed\.$"):
        fuzz.measure(fuzz.Options(kinds=("nothing",)))
    assert asked == []
