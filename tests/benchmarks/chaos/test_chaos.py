"""A whole run under every kind of fault, audited."""

from functools import partial
from multiprocessing import forkserver
from pathlib import Path

import pytest

from benchmarks.chaos.__main__ import Options, measure
from benchmarks.chaos.cluster import Cluster
from benchmarks.chaos.faults import FAULTS
from common.errors import InputError
from common.process.supervisor import Child
from tests.end_to_end.forked import FORKS, become


class Forked:
    """A process of a cluster, as a `Child` is, but without the seconds of imports."""

    last_line, failure = Child.last_line, Child.failure

    def __init__(self, *arguments: str, log: Path) -> None:
        self.log = log
        log.touch()
        self._process = FORKS.Process(target=become, args=(log.parent, log, ("-m", *arguments)))
        self._process.start()
        assert self._process.pid is not None
        self.pid = self._process.pid
        self.kill = self._process.kill

    @property
    def returncode(self) -> int | None:
        return self._process.exitcode

    poll = returncode.fget

    def wait(self, seconds: float | None = None) -> None:
        self._process.join(seconds)

    def end(self, seconds: float = 30.0) -> None:
        self._process.terminate()
        self.wait(seconds)
        self.kill()
        self.wait()


def test_no_kind_of_fault_costs_an_acknowledged_chunk(monkeypatch: pytest.MonkeyPatch) -> None:
    forkserver.ensure_running()  # it imports while certificates are made
    cluster = partial(Cluster, start=Forked)
    monkeypatch.setattr("benchmarks.chaos.__main__.Cluster", cluster)
    # It ends with the last fault, however slow the machine is.
    faults = len(FAULTS)
    report = measure(Options(minutes=60, faults=faults, longest=0.5, seed=5, capacity=20_000))
    found = report.content
    struck, missing = [each["fault"] for each in found["struck"]], found["missing"]
    assert sorted({*struck, *missing}) == sorted(FAULTS)
    assert len(struck) == len(FAULTS)
    told = found["audit"]
    assert told["acknowledged"] > 5 * len(FAULTS)
    assert told["lost"] == told["duplicated"] == told["unknown_rows"] == 0


def test_a_folder_with_something_in_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "old").touch()
    with pytest.raises(InputError, match="holds something already"):
        measure(Options(folder=tmp_path))
