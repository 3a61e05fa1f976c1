"""Trackers, with the real programs in their offline modes, where they are installed."""

import importlib
import json
import logging
import re
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from common.errors import InputError
from common.metrics import Value
from common.settings.presets import PRESETS
from common.settings.stored_config import flat
from learner.telemetry.sinks import tracker as module
from learner.telemetry.sinks.tracker import TrackedRun, TrackerSink
from learner.telemetry.snapshot import Histogram
from tests.extending.whole_run import added
from tests.learner.telemetry.sinks.small_film import write_film
from tests.learner.telemetry.snapshots import snapshot
from tests.patience import PATIENCE

SPREAD = Histogram([3, 0, 1], [0.0, 10.0, 20.0, 40.0])
RUN = TrackedRun("pong-1", "0123456789abcdef" * 2, flat(PRESETS["fast"]))


def program(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError:
        pytest.skip(f"{name} is not installed: pip install 'ale-robot[{name}]'")


def tracked_twice(
    name: Any, film: Path, restart: Callable[[int], object] = lambda steps: None
) -> None:
    """A run of two points, restarted before its second, and then with a histogram and a film."""
    for steps, score in ((1_000, -20.5), (2_000, 18.0)):
        restart(steps)
        sink = TrackerSink(name, RUN)
        sink.start(None)
        sink.add({"play/test_reward": score, "learning/loss": None}, steps)
        if steps == 2_000:
            sink.add_histograms({"hands/press_ms": SPREAD}, steps)
            sink.filmed(film, 1_500)
        sink.close()


@pytest.fixture
def film(tmp_path: Path) -> Path:
    return write_film(tmp_path / "epoch-0001.mp4", 5)


def records_of(file: Path) -> Iterator[bytes]:
    """The records of a log as LevelDB writes it, small ones, after W&B's header of 7 bytes."""
    content, at = file.read_bytes(), 7
    while at + 7 <= len(content):
        length, kind = struct.unpack_from("<HB", content, at + 4)
        if kind == 1:  # a whole one; 0 fills the end of a block of 32 KiB
            yield content[at + 7 : at + 7 + length]
        at = at + 7 + length if kind else (at // 32_768 + 1) * 32_768


def test_wandb_has_settings_points_histograms_and_films(
    tmp_path: Path, film: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wandb = program("wandb")
    from wandb.proto.wandb_internal_pb2 import Record

    monkeypatch.setenv("WANDB_MODE", "offline")

    def restart(steps: int) -> None:
        """Its files are named by the second, in which two runs of this test may begin."""
        wandb.teardown()  # or it would keep the first folder
        (folder := tmp_path / str(steps)).mkdir()
        monkeypatch.setenv("WANDB_DIR", str(folder))

    tracked_twice("wandb", film, restart)
    wandb.teardown()  # its service may not have written the last points before it ends
    shown: list[tuple[int, dict[str, Any]]] = []
    settings: dict[str, str] = {}
    names = set()
    for file in sorted(tmp_path.rglob("*.wandb")):
        for data in records_of(file):
            record = Record.FromString(data)
            if record.HasField("run"):
                names.add((record.run.run_id, record.run.display_name))
                settings |= {each.key: each.value_json for each in record.run.config.update}
            if record.HasField("history"):
                items = record.history.item
                found = {
                    each.key or "/".join(each.nested_key): json.loads(each.value_json)
                    for each in items
                }
                del found["_timestamp"], found["_runtime"], found["_step"]
                shown.append((found.pop("agent_steps"), found))
    first, second, spread, (film_steps, filmed) = shown
    assert first == (1_000, {"play/test_reward": -20.5})
    assert second == (2_000, {"play/test_reward": 18.0})
    told = {"_type": "histogram", "values": SPREAD.counts, "bins": SPREAD.edges}
    assert spread == (2_000, {f"hands/press_ms/{key}": value for key, value in told.items()})
    assert film_steps == 1_500
    (kept,) = tmp_path.rglob(filmed["play/film/path"])
    assert kept.read_bytes() == film.read_bytes()
    assert names == {(RUN.identity, "pong-1")}
    assert settings["learning.n_step"] == "5"


def test_mlflow_has_one_run_over_a_restart(
    tmp_path: Path, film: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mlflow = program("mlflow")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", tmp_path.as_uri())
    monkeypatch.setenv("MLFLOW_ALLOW_FILE_STORE", "true")
    mlflow.set_tracking_uri(tmp_path.as_uri())
    tracked_twice("mlflow", film)
    (run,) = mlflow.search_runs(search_all_experiments=True, output_format="list")
    assert run.info.run_name == "pong-1"
    assert run.data.params["learning.n_step"] == "5"
    history = mlflow.MlflowClient().get_metric_history(run.info.run_id, "play/test_reward")
    assert [(each.step, each.value) for each in history] == [(1_000, -20.5), (2_000, 18.0)]
    (spread,) = tmp_path.rglob("artifacts/hands/press_ms/000002000.json")
    assert json.loads(spread.read_text()) == SPREAD._asdict()
    (kept,) = tmp_path.rglob("artifacts/play/film/epoch-0001.mp4")
    assert kept.read_bytes() == film.read_bytes()


def test_trackio_has_one_run_over_a_restart(
    tmp_path: Path, film: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TRACKIO_DIR", str(tmp_path))
    program("trackio")
    tracked_twice("trackio", film)
    storage = importlib.import_module("trackio.sqlite_storage").SQLiteStorage
    (run,) = storage.get_runs(module.PROJECT)
    assert run == "pong-1-01234567"
    points = storage.get_logs(module.PROJECT, run)
    assert all(each.pop("timestamp") for each in points)
    first, second, spread, filmed = [(each.pop("step"), each) for each in points]
    assert first == (1_000, {"play/test_reward": -20.5})
    assert second == (2_000, {"play/test_reward": 18.0})
    histogram = {"_type": "trackio.histogram", "values": SPREAD.counts, "bins": SPREAD.edges}
    assert spread == (2_000, {"hands/press_ms": histogram})
    assert filmed[0] == 1_500
    (kept,) = tmp_path.rglob(filmed[1]["play/film"]["file_path"])
    assert kept.read_bytes() == film.read_bytes()


def test_a_tracker_that_is_not_installed_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(InputError, match=r"--track wandb needs .*: pip install 'ale-robot\[wandb"):
        TrackerSink("wandb", RUN)


def test_what_another_packages_tracker_needs_is_told_by_its_name() -> None:
    kind = module.TrackerKind("aim", "no_such_package.aim:AimTracker")
    told = r"^--track aim needs the package no_such_package, which is not installed: install it\.$"
    with added(module.TRACKERS, kind), pytest.raises(InputError, match=told):
        TrackerSink("aim", RUN)


def test_a_tracker_that_nobody_knows_is_refused() -> None:
    with pytest.raises(InputError, match=r"^there is no tracker 'wand': did you mean wandb"):
        TrackerSink("wand", RUN)


def test_a_tracker_of_another_package_gets_the_run_in_its_own_thread() -> None:
    (let_go := threading.Event()).set()
    program = Program(hangs=let_go)
    begun: list[TrackedRun] = []

    def begin(run: TrackedRun) -> Program:
        begun.append(run)
        return program.begin(run)

    with added(module.TRACKERS, module.TrackerKind("diary", begin)):
        sink = TrackerSink("diary", RUN)
        assert begun == []
        sink.start(None)
        sink.add({"play/test_reward": 1.0}, 1_000)
        sink.close()
    assert begun == [RUN]
    assert (program.points, program.began_on, program.closed) == ([1_000], "track diary", True)


class Program:
    """A tracker of the test's own: fails at its second point, or waits there to be let go."""

    def __init__(self, refuses: bool = False, hangs: threading.Event | None = None) -> None:
        self.points: list[int] = []
        self.spreads: list[int] = []
        self.began_on = ""
        self.closed = False
        self.fails_next = False
        self._refuses, self._hangs = refuses, hangs

    def begin(self, run: TrackedRun) -> "Program":
        self.began_on = threading.current_thread().name
        if self._refuses:
            raise ConnectionError("log in first")
        return self

    def add_histograms(self, found: Any, agent_steps: int) -> None:
        self.spreads.append(agent_steps)

    def add(self, points: Any, agent_steps: int) -> None:
        if self.points and self._hangs is None:
            raise ConnectionError("nobody is there")
        if self._hangs is not None:
            self._hangs.wait(PATIENCE)
        if self.fails_next:
            raise ConnectionError("it broke off")
        self.points.append(agent_steps)

    def close(self) -> None:
        self.closed = True


def begin(
    monkeypatch: pytest.MonkeyPatch, program: Program, now: Callable[[], float] = time.monotonic
) -> TrackerSink:
    monkeypatch.setitem(sys.modules, "wandb", ModuleType("wandb"))
    kind = module.TrackerKind("wandb", program.begin, extra="wandb")
    monkeypatch.setitem(module.TRACKERS._entries, "wandb", kind)
    sink = TrackerSink("wandb", RUN, now)
    sink.start(None)
    return sink


def test_a_snapshot_has_a_point_and_now_and_then_its_histograms(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    let_go = threading.Event()
    let_go.set()
    program, seconds = Program(hangs=let_go), [0.0]
    sink = begin(monkeypatch, program, lambda: seconds[0])
    sink.write(snapshot({"run/agent_steps": 500}))  # before there are any
    for steps, wait in ((1_000, 0), (2_000, 10), (3_000, 300)):
        seconds[0] += wait
        values: dict[str, Value] = {"run/agent_steps": steps}
        sink.write(snapshot(values, histograms={"hands/press_ms": SPREAD}))
    sink.close()
    assert (program.points, program.spreads) == ([500, 1_000, 2_000, 3_000], [1_000, 3_000])


def test_a_tracker_that_fails_is_given_up_once_and_the_run_goes_on(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    program = Program()
    sink = begin(monkeypatch, program)
    with caplog.at_level(logging.WARNING):
        for steps in (1, 2, 3):
            sink.add({"play/test_reward": 1.0}, steps)
        sink.close()
    sink.add({"play/test_reward": 1.0}, 4)  # goes nowhere
    assert (program.points, program.closed) == ([1], False)
    assert program.began_on == "track wandb"
    (warning,) = [each.message for each in caplog.records]
    told = "--track wandb is given up, and the run goes on: ConnectionError('nobody is there'), "
    assert re.fullmatch(rf"{re.escape(told + __file__)}:\d+", warning)


def test_a_tracker_that_cannot_begin_is_given_up_too(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    sink = begin(monkeypatch, Program(refuses=True))
    sink.add({"play/test_reward": 1.0}, 1)
    sink.close()
    assert "is given up, and the run goes on: ConnectionError('log in first'), " in caplog.text


def test_a_tracker_whose_factory_is_misspelt_is_refused() -> None:
    entry = module.TrackerKind("diary", "tests.patience:begin")
    with added(module.TRACKERS, entry), pytest.raises(InputError) as error:
        TrackerSink("diary", RUN)
    told = "the factory of the tracker 'diary' fails (AttributeError("
    assert str(error.value).startswith(told)


def test_a_tracker_that_hangs_holds_up_nobody_and_loses_points(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(module, "_MAX_WAITING", 3)
    monkeypatch.setattr(module, "_FAREWELL", 0.05)
    let_go = threading.Event()
    program = Program(hangs=let_go)
    sink = begin(monkeypatch, program)
    for steps in range(10):  # one is under way at most, three wait
        sink.add({"play/test_reward": 1.0}, steps)
    assert "is too slow: it loses points" in caplog.text
    sink.close()
    assert "does not answer: its last points are lost" in caplog.text
    let_go.set()
    monkeypatch.setattr(module, "_FAREWELL", PATIENCE)
    sink.close()
    assert program.closed
    assert 3 <= len(program.points) <= 4
    assert caplog.text.count("is too slow") == 1
    assert f"lacks {10 - len(program.points)} points" in caplog.text


def test_a_tracker_that_fails_behind_many_points_holds_up_no_end(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(module, "_MAX_WAITING", 3)
    monkeypatch.setattr(module, "_FAREWELL", PATIENCE)
    let_go = threading.Event()
    program = Program(hangs=let_go)
    sink = begin(monkeypatch, program)
    for steps in range(10):
        sink.add({"play/test_reward": 1.0}, steps)
    program.fails_next = True
    let_go.set()
    began = time.monotonic()
    sink.close()
    assert time.monotonic() - began < PATIENCE
    assert "is given up" in caplog.text
    assert "does not answer" not in caplog.text


def test_settings_are_flat_and_plain() -> None:
    assert RUN.settings["game"] == "pong"
    assert RUN.settings["learning.learning_rate"] == 5e-4
    assert RUN.settings["exploration.ez_greedy"] is False
    assert all(isinstance(value, bool | int | float | str) for value in RUN.settings.values())
