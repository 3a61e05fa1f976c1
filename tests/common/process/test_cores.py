"""The cores of a process: those of its affinity, or fewer by the control groups around it."""

import os
from pathlib import Path

import pytest

from common.process import cores
from common.process.cores import usable_cores


@pytest.fixture
def groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine of 8 cores, on which this process is in a service's group within a slice."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(8)))
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    monkeypatch.setattr(cores, "_GROUPS", tmp_path)
    own = tmp_path / "own"
    own.write_text("1:name=systemd:/x\n0::/slice/service\n")
    monkeypatch.setattr(cores, "_OWN_GROUP", own)
    (tmp_path / "slice" / "service").mkdir(parents=True)
    return tmp_path


@pytest.mark.parametrize(
    ("service", "around", "expected"),
    [
        ("max 100000", "max 100000", 8),
        ("200000 100000", "max 100000", 2),
        ("250000 100000", "max 100000", 3),  # two and a half
        ("10000 100000", "max 100000", 1),
        ("max 100000", "400000 100000", 4),
        ("600000 100000", "400000 100000", 4),
        ("1600000 100000", "max 100000", 8),
        ("nonsense", "max 100000", 8),
    ],
)
def test_the_tightest_group_counts(groups: Path, service: str, around: str, expected: int) -> None:
    (groups / "slice" / "service" / "cpu.max").write_text(service + "\n")
    (groups / "slice" / "cpu.max").write_text(around + "\n")
    assert usable_cores() == expected


def test_a_containers_own_group_is_the_outermost_that_it_sees(groups: Path) -> None:
    (groups / "own").write_text("0::/\n")
    (groups / "cpu.max").write_text("100000 100000\n")
    assert usable_cores() == 1


@pytest.mark.usefixtures("groups")
def test_without_limits_the_affinity_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    assert usable_cores() == 8
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {3, 5})
    assert usable_cores() == 2
    monkeypatch.setattr(cores, "_OWN_GROUP", Path("/nowhere"))
    assert usable_cores() == 2
