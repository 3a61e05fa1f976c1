"""Local mode's children: who gives way to whom, and whom a terminal's Ctrl-C reaches."""

import os
import sys
from pathlib import Path

import pytest

from common.errors import InputError
from learner.local_launcher import LocalLauncher
from tests.patience import PATIENCE

_TELLS = """import os, sys
sys.stdin.read()
print(os.getpriority(os.PRIO_PROCESS, 0), os.getpgrp() == os.getpid())
"""


def crew_of(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    script: str,
    *,
    evaluators: int = 0,
    give_way: bool = True,
) -> LocalLauncher:
    """An actor, and evaluators, that are this script."""
    child = tmp_path / "child"
    child.write_text(f"#!{sys.executable}\n{script}\n")
    child.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(child))
    return LocalLauncher(
        "endpoint", "run", 1, 1, evaluators, tmp_path, ["--sync"], give_way=give_way
    )


@pytest.mark.parametrize("give_way", [True, False])
def test_children_give_way_only_where_time_waits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, give_way: bool
) -> None:
    monkeypatch.setattr("learner.local_launcher._LEAVE", 60.0)
    crew = crew_of(tmp_path, monkeypatch, _TELLS, evaluators=1, give_way=give_way)
    roles = ("actor", "evaluator")
    assert [crew.works(role) for role in roles] == [True, True]
    crew.close()
    assert [crew.works(role) for role in roles] == [False, False]
    ours = os.getpriority(os.PRIO_PROCESS, 0)
    nice = min(ours + 10, 19) if give_way else ours
    for name in ("actor-1", "evaluator-1"):
        assert (tmp_path / f"{name}.log").read_text().split() == [str(nice), "True"]


def notes_of(crew: LocalLauncher, *, finished: bool = False) -> list[str]:
    """What is noted once the actor has ended."""
    crew._children[0].process.wait(PATIENCE)
    return crew.watch(finished=finished)


@pytest.mark.parametrize(
    ("script", "how"),
    [
        ("print('no room'); raise SystemExit(3)", "status 3"),
        ("print('no room'); raise SystemExit(0)", "status 0"),
        (
            "import os; print('no room', flush=True); os.kill(os.getpid(), 9)",
            "signal 9",
        ),
    ],
)
def test_a_child_that_cannot_start_is_given_up_with_its_last_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, how: str
) -> None:
    monkeypatch.setattr("learner.local_launcher._STILLBORN", 1e9)
    crew = crew_of(tmp_path, monkeypatch, script)
    for _ in range(2):
        assert notes_of(crew) == [f"actor-1 ended by {how}, started again"]
    with pytest.raises(InputError, match=f"^actor-1 cannot start: .*{how} and said: no room "):
        notes_of(crew)
    crew.close()


def test_a_child_that_has_worked_may_end_often(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("learner.local_launcher._STILLBORN", 0.0)
    crew = crew_of(tmp_path, monkeypatch, "raise SystemExit(0)")
    for _ in range(4):
        assert notes_of(crew) == ["actor-1 ended by status 0, started again"]
    assert notes_of(crew, finished=True) == []  # it left because the run is over
    crew.close()
