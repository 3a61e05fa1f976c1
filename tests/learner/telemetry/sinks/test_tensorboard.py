"""Curves, read back with TensorBoard's own reader."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from learner.telemetry.sinks.epochs_csv import EpochRow
from learner.telemetry.sinks.tensorboard import TensorBoardSink
from tests.learner.telemetry.snapshots import changed, snapshot

STATUS = snapshot(
    {
        "run/agent_steps": 1_000,
        "learning/epsilon": 0.5,
        "learning/updates": 125,
        "learning/loss": 0.25,
        "stream/chunks_made": 17,
        "stream/chunks_acked": 15,
        "stream/chunks_refused": 1,
        "stream/actors_alive": 1,
        "play/valid_frame_share": 0.5,
        "learning/held_out_std": None,
        "hands/press_p50": 50.0,
        "hands/release_p50": 16.5,
        "hands/release_p99": 33.5,
        "gates/failed": 1,
    }
)
ROW = EpochRow(
    epoch=1,
    phase="test",
    steps=12_500,
    nr_games=10,
    average_reward=-20.5,
    min_game_reward=-21.0,
    max_game_reward=-19.0,
    last_exploration_rate=0.05,
    total_train_steps=25_000,
    replay_memory_count=25_500,
    meanq=0.75,
    meancost=0.0,
    weight_updates=6_250,
    total_time=100.0,
    epoch_time=25.0,
    steps_per_second=500.0,
)


def started(folder: Path, resumed_at: int | None = None) -> TensorBoardSink:
    curves = TensorBoardSink(folder)
    curves.start(resumed_at)
    return curves


def read(folder: Path) -> dict[str, list[tuple[int, float]]]:
    events = EventAccumulator(str(folder))
    events.Reload()
    return {
        tag: [(point.step, point.value) for point in events.Scalars(tag)]
        for tag in events.Tags()["scalars"]
    }


def test_status_and_epochs_over_agent_steps(tmp_path: Path) -> None:
    curves = started(tmp_path)
    curves.write(STATUS)
    curves.write(changed(STATUS, {"run/agent_steps": 2_000, "learning/loss": 0.125}))
    curves.phase(ROW, 25_500)
    curves.close()
    points = read(tmp_path)
    assert points["learning/loss"] == [(1_000, 0.25), (2_000, 0.125)]
    assert points["gates/refused_chunks"] == points["stream/chunks_refused"]
    assert points["learning/updates"] == [(1_000, 125), (2_000, 125)]
    assert points["stream/chunks_made"][0] == (1_000, 17)
    assert points["stream/actors_alive"][0] == (1_000, 1)
    assert points["gates/valid_frames"][0] == (1_000, 0.5)
    assert points["gates/failed"][0] == (1_000, 1)
    assert points["gates/press_p50_ms"][0] == (1_000, 50.0)
    assert "gates/press_p99_ms" not in points  # not measured
    assert points["gates/release_p50_ms"][0] == (1_000, 16.5)
    assert points["gates/release_p99_ms"][0] == (1_000, 33.5)
    assert points["play/epoch_test_reward"] == [(25_500, -20.5)]
    assert points["learning/epoch_test_mean_max_q"] == [(25_500, 0.75)]
    assert {tag.split("/")[0] for tag in points} == {"play", "learning", "stream", "gates"}


def test_the_unknown_has_no_point(tmp_path: Path) -> None:
    curves = started(tmp_path)
    curves.write(STATUS)
    curves.phase(replace(ROW, average_reward=None), 25_500)
    curves.close()
    points = read(tmp_path)
    assert "learning/mean_max_q" not in points
    assert "gates/max-Q_deviation" not in points
    assert "play/epoch_test_reward" not in points


def test_resume_drops_what_came_after_the_checkpoint(tmp_path: Path) -> None:
    curves = started(tmp_path)
    for steps, loss in ((1_000, 4.0), (2_000, 2.0), (3_000, 1.0)):
        curves.write(changed(STATUS, {"run/agent_steps": steps, "learning/loss": loss}))
    curves.close()
    curves = started(tmp_path, resumed_at=2_000)
    curves.write(changed(STATUS, {"run/agent_steps": 2_500, "learning/loss": 8.0}))
    curves.close()
    assert read(tmp_path)["learning/loss"] == [(1_000, 4.0), (2_000, 2.0), (2_500, 8.0)]


def test_import_is_light_and_silent() -> None:
    code = "import sys, learner.telemetry.sinks.tensorboard; assert 'torch' not in sys.modules"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")
