"""A whole run under every kind of fault, audited."""

from collections.abc import Callable
from functools import partial
from multiprocessing import forkserver
from pathlib import Path

import pytest

from benchmarks.chaos.__main__ import FLAGS, Options, measure
from benchmarks.chaos.cluster import EVALUATOR, Cluster
from benchmarks.chaos.faults import FAULTS
from common.errors import InputError
from common.process.supervisor import Child
from tests.forked import FORKING
from tests.patience import PATIENCE

AT_THE_EVALUATOR = {
    "kill -9",
    "pause (SIGSTOP)",
    "network away, what was sent arrives later",
}
"""Faults that strike an evaluator here, whatever the seed draws; none is ever missing."""
LITTLE = ("--learning.train-period=4", "--learning.batch-size=8")
"""Flags by which the learner leaves the cores to others."""


def start(module: str, *arguments: str, log: Path) -> Child:
    """Starts a process; an actor plays at the pace of a robot, and leaves the cores to others."""
    paced = ("tests.benchmarks.chaos.paced",) if module == "benchmarks.chaos.witness" else ()
    return Child(*paced, module, *arguments, log=log)


def evaluator(targets: Callable[[Cluster], tuple[str, ...]], cluster: Cluster) -> tuple[str, ...]:
    """Returns the evaluator alone, which is among the targets."""
    assert EVALUATOR in targets(cluster)
    return (EVALUATOR,)


def test_no_kind_of_fault_costs_an_acknowledged_chunk(monkeypatch: pytest.MonkeyPatch) -> None:
    forkserver.ensure_running()  # it imports while certificates are made
    for name, member in FORKING.items():  # an actor of a former version is started, as a program
        monkeypatch.setattr(Child, name, member, raising=False)
    monkeypatch.setattr("benchmarks.chaos.__main__.Cluster", partial(Cluster, start=start))
    monkeypatch.setattr("benchmarks.chaos.__main__.FLAGS", (*FLAGS, *LITTLE))
    # It ends with the last fault, however slow the machine is.
    for module in ("faults", "storm", "__main__"):
        monkeypatch.setattr(f"benchmarks.chaos.{module}.PATIENCE", PATIENCE)
    for fault in AT_THE_EVALUATOR:
        targets = partial(evaluator, FAULTS[fault].targets)
        monkeypatch.setitem(FAULTS, fault, FAULTS[fault]._replace(targets=targets))
    faults = len(FAULTS)
    report = measure(Options(minutes=60, faults=faults, longest=0.3, seed=20, capacity=20_000))
    found = report.content
    struck, missing = [each["fault"] for each in found["struck"]], found["missing"]
    assert sorted({*struck, *missing}) == sorted(FAULTS)
    assert len(struck) == len(FAULTS)
    assert found["certificates"]
    told = found["audit"]
    assert told["acknowledged"] > 5 * len(FAULTS)
    assert told["lost"] == told["duplicated"] == told["unknown_rows"] == 0
    # A test is over after each fault; a learner that is killed may lose its last.
    assert found["tests"]["tested"] > len(FAULTS) - found["starts"]["learner"]
    assert found["tests"]["repeated"] == found["tests"]["short"] == 0
    hit = {each["fault"] for each in found["struck"] if each["target"] == EVALUATOR}
    assert hit >= AT_THE_EVALUATOR


def test_a_folder_with_something_in_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "old").touch()
    with pytest.raises(InputError, match="is not empty"):
        measure(Options(folder=tmp_path))
