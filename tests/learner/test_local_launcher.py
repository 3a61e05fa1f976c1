"""Local mode's children: which there are, and what each is told."""

import json
import os
import sys
from pathlib import Path

import pytest

from common.process import supervisor
from common.run.folder import RunFolder
from common.settings.clock import ClockConfig
from common.settings.presets import PRESETS
from learner.local_launcher import launch
from learner.options import LearnerOptions
from tests.patience import PATIENCE

_TELLS = """import json, os, sys
sys.stdin.read()
print(json.dumps([os.getpriority(os.PRIO_PROCESS, 0), *sys.argv[1:]]))
"""


@pytest.mark.parametrize("low_priority", [True, False])
def test_actors_and_evaluators_are_told_their_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, low_priority: bool
) -> None:
    monkeypatch.setattr(supervisor, "GRACE", PATIENCE)
    child = tmp_path / "child"
    child.write_text(f"#!{sys.executable}\n{_TELLS}\n")
    child.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(child))
    logs = tmp_path / "r" / "logs"
    options = LearnerOptions(
        PRESETS["robot"],
        envs=4,
        precision="float32",
        kernel="native",
        clock=ClockConfig(sync=low_priority),
        certificates=Path("c"),
    )
    children = launch(options, "tcp/h:1", RunFolder(tmp_path, "r"))
    roles = ("actor", "evaluator")
    assert [children.works(role) for role in roles] == [True, True]
    children.close()
    assert [children.works(role) for role in roles] == [False, False]
    ours = os.getpriority(os.PRIO_PROCESS, 0)
    nice = min(ours + 10, 19) if low_priority else ours
    actors = ["--envs", "4", "--precision", "float32", "--kernel", "native"]
    for name, own in (("actor-1", actors), ("evaluator-1", ["--evaluator"])):
        told = json.loads((logs / f"{name}.log").read_text())
        common = ["--connect", "tcp/h:1", "--run", "r", *options.clock.flags()]
        assert told == [
            nice,
            "-m",
            "actors",
            "--name",
            name,
            *common,
            "--certificates",
            "c",
            *own,
            "--leash",
        ]
