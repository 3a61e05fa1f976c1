"""`benchmarks.actor_steps` with real processes, for a moment."""

import json
import os
import time
from pathlib import Path
from typing import Any

import pytest

from benchmarks import actor_steps, hosted_run
from benchmarks.report import run
from common.command_line.parser import check_bounds
from common.errors import InputError
from common.process.supervisor import Child


@pytest.mark.usefixtures("forks")
def test_an_actor_plays_on_a_core_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[set[int]] = []

    def watched(module: str, *arguments: str, **streams: Any) -> Any:
        seen.append(os.sched_getaffinity(0))
        return Child(module, *arguments, **streams)

    before = os.sched_getaffinity(0)
    bound: list[set[int]] = []
    bind = os.sched_setaffinity

    def noted(process: int, cores: set[int]) -> None:
        bind(process, cores)
        if process:
            bound.append(os.sched_getaffinity(process))

    for module in (actor_steps, hosted_run):
        monkeypatch.setattr(module, "Child", watched)
    monkeypatch.setattr(os, "sched_setaffinity", noted)
    with (
        actor_steps._one_core_set_apart() as core,
        actor_steps.Hub("ale", "pong", core) as hub,
    ):
        # The second actor's first chunk follows the first one's last.
        assert all(hub.steps_per_second(envs, 0.2) > 0 for envs in (1, 2))
        with pytest.raises(InputError, match="said: --envs is 1000"):
            hub.steps_per_second(1000, 0.2)
    assert bound == [{core}] * 3
    assert seen == [before - {core} or before] * 4
    assert os.sched_getaffinity(0) == before


def test_a_rate_is_steps_between_two_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    marks = iter([(1.0, 64), (2.0, 128), (2.5, 192), (6.0, 448), (7.0, 512)])
    hub = object.__new__(actor_steps.Hub)
    hub._actors, hub.endpoint, hub._core, hub.children = 0, "", 0, {}
    monkeypatch.setattr(hub, "_next_chunk", lambda *_: next(marks))
    monkeypatch.setattr(actor_steps, "_FIRST", 3)
    monkeypatch.setattr(actor_steps, "Child", lambda *_, **__: Process())
    monkeypatch.setattr(os, "sched_setaffinity", lambda *_: None)
    monkeypatch.setattr(time, "sleep", lambda _: None)
    assert hub.steps_per_second(1, 5.0) == (512 - 192) / (7.0 - 2.5)


class Process:
    pid = 0

    def end(self) -> None:
        pass


def test_table_and_json(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    class Told:
        def __init__(self, env: str, *_: object) -> None:
            self.rates = iter([1.0, 10.0, 7.0, 70.0] if env == "ale" else [2.0, 20.0, 4.0, 40.0])

        def __enter__(self) -> "Told":
            return self

        def __exit__(self, *_: object) -> None: ...
        def steps_per_second(self, envs: int, seconds: float) -> float:
            return next(self.rates)

    results = tmp_path / "actor.json"
    monkeypatch.setattr(actor_steps, "Hub", Told)
    arguments = ["--turns", "2", "--envs", "1", "4", "--json", str(results)]
    run("actor_steps", actor_steps.Options, actor_steps.measure, arguments)
    found = json.loads(results.read_text())
    assert found["ale"] == {"1": 4.0, "4": 40.0}
    assert found["robot"] == {"1": 3.0, "4": 30.0}
    assert found["rows"][3] == {
        "kind": "robot",
        "environments": 4,
        "per second": 30.0,
        "least": 20.0,
        "most": 40.0,
    }
    assert "ALE-Only" in capsys.readouterr().out


def test_settings_that_cannot_work() -> None:
    for name, value in (("envs", ()), ("envs", (0,)), ("turns", 0), ("seconds", 0.0)):
        with pytest.raises(InputError, match=name):
            check_bounds(actor_steps.Options(**{name: value}))  # type: ignore[arg-type]
