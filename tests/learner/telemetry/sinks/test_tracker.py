"""Trackers, with the real programs in their offline modes, where they are installed."""

import importlib
import logging
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from common.errors import InputError
from common.run.presets import PRESETS
from common.run.stored_config import flat
from learner.telemetry.sinks import tracker as module
from learner.telemetry.sinks.tracker import TrackedRun, TrackerSink

RUN = TrackedRun("pong-1", "0123456789abcdef" * 2, flat(PRESETS["fast"]))


def program(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError:
        pytest.skip(f"{name} is not installed: pip install 'ale-robot[{name}]'")


def tracked_twice(name: Any) -> None:
    """A run of two points, restarted before its second."""
    for steps, score in ((1_000, -20.5), (2_000, 18.0)):
        sink = TrackerSink(name, RUN)
        sink.add({"play/test_reward": score, "learning/loss": None}, steps)
        sink.close()


def records_of(file: Path) -> Iterator[bytes]:
    """The records of a log as LevelDB writes it, small ones, after W&B's header of 7 bytes."""
    content, at = file.read_bytes(), 7
    while at + 7 <= len(content):
        length, kind = struct.unpack_from("<HB", content, at + 4)
        if kind == 1:  # a whole one; 0 fills the end of a block of 32 KiB
            yield content[at + 7 : at + 7 + length]
        at = at + 7 + length if kind else (at // 32_768 + 1) * 32_768


def test_wandb_has_settings_and_points(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program("wandb")
    from wandb.proto.wandb_internal_pb2 import Record

    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("WANDB_DIR", str(tmp_path))
    tracked_twice("wandb")
    points, settings, names = [], {}, set()
    for file in sorted(tmp_path.rglob("*.wandb")):
        for data in records_of(file):
            record = Record.FromString(data)
            if record.HasField("run"):
                names.add((record.run.run_id, record.run.display_name))
                settings |= {each.key: each.value_json for each in record.run.config.update}
            if record.HasField("history"):
                items = record.history.item
                found = {each.key or "/".join(each.nested_key): each.value_json for each in items}
                points.append((int(found["agent_steps"]), float(found["play/test_reward"])))
    assert points == [(1_000, -20.5), (2_000, 18.0)]
    assert names == {(RUN.identity, "pong-1")}
    assert settings["learning.n_step"] == "5"


def test_mlflow_has_one_run_over_a_restart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mlflow = program("mlflow")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", tmp_path.as_uri())
    monkeypatch.setenv("MLFLOW_ALLOW_FILE_STORE", "true")
    mlflow.set_tracking_uri(tmp_path.as_uri())
    tracked_twice("mlflow")
    (run,) = mlflow.search_runs(search_all_experiments=True, output_format="list")
    assert run.info.run_name == "pong-1"
    assert run.data.params["learning.n_step"] == "5"
    history = mlflow.MlflowClient().get_metric_history(run.info.run_id, "play/test_reward")
    assert [(each.step, each.value) for each in history] == [(1_000, -20.5), (2_000, 18.0)]


def test_trackio_has_one_run_over_a_restart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TRACKIO_DIR", str(tmp_path))
    program("trackio")
    tracked_twice("trackio")
    storage = importlib.import_module("trackio.sqlite_storage").SQLiteStorage
    (run,) = storage.get_runs(module.PROJECT)
    assert run == "pong-1-01234567"
    points = storage.get_logs(module.PROJECT, run)
    assert [(each["step"], each["play/test_reward"]) for each in points] == [
        (1_000, -20.5),
        (2_000, 18.0),
    ]


def test_a_tracker_that_is_not_installed_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(InputError, match=r"--track wandb needs .*: pip install 'ale-robot\[wandb"):
        TrackerSink("wandb", RUN)


class Failing:
    """A program whose server goes away after a point."""

    def __init__(self, run: TrackedRun) -> None:
        self.points: list[int] = []

    def log(self, points: Any, agent_steps: int) -> None:
        if self.points:
            raise ConnectionError("nobody is there")
        self.points.append(agent_steps)

    def close(self) -> None:
        raise AssertionError("it was given up")


def test_a_tracker_that_fails_is_given_up_once_and_the_run_goes_on(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setitem(module.TRACKERS, "wandb", Failing)
    sink = TrackerSink("wandb", RUN)
    with caplog.at_level(logging.WARNING):
        for steps in (1, 2, 3):
            sink.add({"play/test_reward": 1.0}, steps)
        sink.close()
    assert [each.message for each in caplog.records] == [
        "--track wandb is given up, and the run goes on: nobody is there"
    ]


def test_a_tracker_that_cannot_begin_is_given_up_too(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(run: TrackedRun) -> Failing:
        raise ConnectionError("log in first")

    monkeypatch.setitem(module.TRACKERS, "wandb", refuse)
    sink = TrackerSink("wandb", RUN)
    sink.add({"play/test_reward": 1.0}, 1)
    sink.close()
    assert "--track wandb is given up, and the run goes on: log in first" in caplog.text


def test_settings_are_flat_and_plain() -> None:
    assert RUN.settings["game"] == "pong"
    assert RUN.settings["learning.learning_rate"] == 2.5e-4
    assert RUN.settings["exploration.ez_greedy"] is True
    assert all(isinstance(value, bool | int | float | str) for value in RUN.settings.values())
