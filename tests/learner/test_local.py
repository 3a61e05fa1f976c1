"""Local mode's children: who gives way to whom, and whom a terminal's Ctrl-C reaches."""

import os
import sys
from pathlib import Path

import pytest

from learner.local import Crew

_CHILD = f"""#!{sys.executable}
import os, sys
sys.stdin.read()
print(os.getpriority(os.PRIO_PROCESS, 0), os.getpgrp() == os.getpid())
"""


@pytest.mark.parametrize("give_way", [True, False])
def test_children_give_way_only_where_time_waits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, give_way: bool
) -> None:
    child = tmp_path / "child"
    child.write_text(_CHILD)
    child.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(child))
    monkeypatch.setattr("learner.local._LEAVE", 60.0)
    crew = Crew("endpoint", "run", 1, 1, 1, tmp_path, ["--sync"], give_way=give_way)
    roles = ("actor", "evaluator")
    assert [crew.works(role) for role in roles] == [True, True]
    crew.close()
    assert [crew.works(role) for role in roles] == [False, False]
    ours = os.getpriority(os.PRIO_PROCESS, 0)
    nice = min(ours + 10, 19) if give_way else ours
    for name in ("actor-1", "evaluator-1"):
        assert (tmp_path / f"{name}.log").read_text().split() == [str(nice), "True"]
